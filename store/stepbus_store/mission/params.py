"""The parameters of the mission of a store: orders, shelves, outlet, tolerances."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from stepbus_participant import (
    Count,
    File,
    Finite,
    NonNegative,
    Positive,
    Settings,
    Text,
    Vector3,
    parameters,
    suggest,
)
from stepbus_participant.parameters import Keys

from .geometry import Spot


class Order(Settings):
    """An order: any item of a type, or one specific item; the other field is empty."""

    short = "type"

    type: str = ""
    """Item type, e.g. `cola`."""
    item: str = ""
    """Name of an item, e.g. `cola_a1_3`."""

    def __str__(self) -> str:
        return self.item or self.type

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield an order without content, or with both."""
        if bool(self.type) == bool(self.item):
            yield (), "needs either an item type, `type: cola`, or an item, `item: cola_a1_3`"


class Shelf(Settings):
    """A shelf."""

    front: tuple[Finite, Finite]
    """x and y of a point on its front line [m]."""
    yaw: Finite = 0.0
    """Heading of a robot that faces it [rad]."""

    @property
    def spot(self) -> Spot:
        """Return the point of its front line, with the heading that faces it."""
        return Spot(x=self.front[0], y=self.front[1], yaw=self.yaw)


class Outlet(Settings):
    """Place for sold items: one spot per order, from left to right, the back row first."""

    position: Vector3
    """Centre of the rows, on top of the outlet [m]."""
    yaw: Finite = math.pi / 2
    """Heading of a robot that faces it [rad]."""
    pitch: Positive = 0.12
    """Distance between spots [m]."""
    length: Positive = 0.5
    """Length of a row of spots [m]."""
    rows: Count = 1
    """Number of rows."""
    depth: Positive = 0.14
    """Distance between rows [m]."""
    link: Text = "outlet_top"
    """Link of the outlet; the gripper may touch it while placing an item."""


class Tolerances(Settings):
    """Tolerances."""

    found: Positive = 0.06
    """Largest distance of a detection from the expected position [m]."""
    steady: Positive = 0.002
    """Largest distance between two consecutive detections [m]."""
    placed: Positive = 0.01
    """Largest distance of an item from its spot [m]."""
    moved: Positive = 0.002
    """Largest displacement of any other item [m]."""
    tilt: Positive = 0.1
    """Largest tilt of a placed item [rad]."""


class Waits(Settings):
    """Durations and timeouts."""

    answer: Positive = 2.0
    """Timeout for the controller to answer a goal [s]."""
    motion: Positive = 60.0
    """Timeout for a motion to end [s]."""
    camera: Positive = 3.0
    """Timeout for the first detections [s]."""
    still: Positive = 0.2
    """Delay after a motion before detections count [s]."""
    grip: Positive = 0.2
    """Delay after the gripper has closed or lifted before it counts as holding the item [s]."""
    rest: Positive = 0.5
    """Time that everything must be at rest before a measurement and in an emergency stop [s]."""
    halt: Positive = 10.0
    """Timeout for everything to come to rest [s]."""
    release: Positive = 60.0
    """Timeout for the release of an emergency stop; then the run ends [s]."""
    lost: Positive = 0.1
    """Time without a grip until a carried item counts as dropped [s]."""


class Params(Settings):
    """Parameters of `stepbus_store.mission`."""

    orders: Annotated[tuple[Order, ...], msgspec.Meta(min_length=1)]
    """Orders: a list of item types; also `type: cola` or `item: juice_b2_3`."""
    shelves: dict[str, Shelf]
    """Shelves by name. The item `cola_a1_3` in slot `a1_3` is on the shelf whose name starts
    the slot's."""
    outlet: Outlet
    """Place where the robot puts sold items."""
    tuck: dict[str, Finite]
    """Posture of the arm while the base drives without an item: joint → position [rad]."""
    catalog: File | None = None
    """World file whose `stock.types` may be ordered, even if sold out. Default: the types of
    the items in the plant."""
    home: Vector3 = (0.0, 0.0, 0.0)
    """x, y, yaw of the base in front of the outlet [m, m, rad]."""
    stand: Positive = 0.45
    """Distance of the base from a front line [m]."""
    reverse: Positive = 0.3
    """How far the base backs up from there before it turns [m]."""
    carry: tuple[Finite, Finite] = (0.45, 0.0)
    """Carrying position of an item: ahead and to the left of the base [m]."""
    verification: Literal["camera", "truth"] = "truth"
    """How to verify the position of a sold item. `camera`: by an image from above the outlet;
    other items are not checked. `truth`: by the plant's poses, which also show whether other
    items moved; for comparison."""
    prefix: str = ""
    """Prefix of this robot's names in the plant, such as `left/` if two bodies from one URDF
    share a world. All other parameters name joints and links without it."""
    base_frame: Text = "chassis"
    """Reference link of the detections."""
    tip: Text = "grasp"
    """Frame of the gripper: z along the approach, y along the opening."""
    force: Positive = 15.0
    """Maximum force of each finger [N]; slip and weight determine how much is used."""
    opening: Positive = 0.09
    """Width of the open gripper [m]."""
    grasp_depth: Positive = 0.015
    """Depth of the tip below the upper end of the body [m]."""
    grasp_reach: Positive = 0.065
    """Largest length of an item inside the gripper, beyond the tip [m]."""
    width_tolerance: Positive = 0.008
    """Tolerance of the width of a held item below the expected one [m]."""
    down: NonNegative = 1.5
    """Duration of the motions down and up; 0: as fast as the limits allow [s]."""
    view_height: Positive = 0.2
    """Height of the tip above the item for detection [m]."""
    approach_height: Positive = 0.1
    """Height of the tip above the grip, and above the release [m]."""
    lift_height: Positive = 0.1
    """Height by which an item is lifted [m]."""
    safe_height: Positive = 0.6
    """Largest height of the tip while the base carries an item [m]."""
    recover: bool = False
    """Whether to bring the arm back after a failure, once everything is at rest: to the tuck
    posture, or with an item to `carry` at `safe_height`."""
    together: bool = False
    """Whether to move the arm while the base drives, if that is free of collisions. Otherwise
    the arm is tucked in, or has lowered the item, before the base moves."""
    lower_step: Positive = 0.1
    """Step size for lowering an item [m]."""
    drop_height: Positive = 0.003
    """Height of the item above the outlet at the release [m]."""
    attempts: Count = 2
    """Maximum attempts to grasp an item."""
    corrections: Count = 3
    """Maximum corrections per approach."""
    views: Count = 3
    """Number of views without the item before it counts as missing."""
    tolerances: Tolerances = Tolerances()
    """Tolerances."""
    waits: Waits = Waits()
    """Durations and timeouts."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong between orders, shelves and outlet."""
        for key in ("shelves", "tuck"):
            if not getattr(self, key):
                yield (key,), "is empty"
        yield from self._unknown_types()
        items = [order.item for order in self.orders if order.item]
        for name in dict.fromkeys(items):
            if items.count(name) > 1:
                yield ("orders",), f"item {name!r} is ordered twice"
        outlet = self.outlet
        count = -(-len(self.orders) // outlet.rows)
        if count * outlet.pitch > outlet.length + 1e-9:
            text = f"{count} orders, {outlet.pitch:g} m apart, do not fit into {outlet.length:g} m"
            if outlet.rows > 1:
                text = f"{outlet.rows} rows for {len(self.orders)} orders: {text}"
            yield ("outlet",), text

    def _unknown_types(self) -> Iterator[tuple[Keys, str]]:
        if self.catalog is None:
            return
        try:
            types = _types_in(self.catalog)
        except ValueError as exc:
            yield ("catalog",), str(exc)
            return
        for number, order in enumerate(self.orders):
            if order.type and order.type not in types:
                yield ("orders", number), unknown_type(order.type, types)

    def outlet_spot(self, number: int, planned: int) -> Spot:
        """Return the spot of an order in the outlet; number: counted from 0.

        planned: how many orders there were at the start; further ones stand beside those, on the
        right and on the left in turn, so that no spot of an item that stands there moves.
        """
        outlet = self.outlet
        x, y, _ = outlet.position
        width = -(-planned // outlet.rows)
        row, column = divmod(number, width)
        if number >= planned:
            further, row = divmod(number - planned, outlet.rows)
            column = -1 - further // 2 if further % 2 else width + further // 2
        left = outlet.pitch * ((width - 1) / 2 - column)
        behind = outlet.depth * ((outlet.rows - 1) / 2 - row)
        return Spot(x=x, y=y, yaw=outlet.yaw).ahead(behind, left=left)

    def is_in_outlet(self, number: int, planned: int) -> bool:
        """Return whether the spot of an order is on the outlet, as of `outlet_spot`."""
        outlet = self.outlet
        spot = self.outlet_spot(number, planned)
        away = math.hypot(spot.x - outlet.position[0], spot.y - outlet.position[1])
        widest = math.hypot(outlet.length / 2 - outlet.pitch / 2, outlet.depth * outlet.rows / 2)
        along = widest if outlet.rows > 1 else outlet.length / 2 - outlet.pitch / 2
        return away <= along + 1e-9


def unknown_type(given: str, types: Sequence[str]) -> str:
    """Return the sentence about an order of a type that the shop does not have."""
    known = suggest(given, types) or f"; it has {', '.join(types) or 'no items at all'}"
    return f"type {given!r} is unknown{known}"


def _types_in(path: Path) -> list[str]:
    """Return the keys of `stock.types` of a world file.

    Raises ValueError with a sentence for a file without any, or one that cannot be read.
    """
    stock = parameters.read_yaml(path, "a world needs at least 'bodies'").data.get("stock")
    types = stock.get("types") if isinstance(stock, dict) else None
    if not isinstance(types, dict) or not types:
        raise ValueError(f"{path.name} has no stock.types")
    return list(types)
