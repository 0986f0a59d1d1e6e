"""What the scenario says about the sales, as rows: goods, shelves, outlet, tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from .geometry import Spot


@dataclass(frozen=True, kw_only=True)
class Ports:
    """Names of the ports; summary may be the same as events."""

    poses: str
    detections: str
    gripper: str
    odometry: str
    status: str
    goal: str
    events: str
    summary: str


@dataclass(frozen=True, kw_only=True)
class Order:
    """What a customer wants: any item of a kind, or exactly one item; the other one is empty."""

    kind: str = ""
    item: str = ""

    def __str__(self) -> str:
        return self.item or self.kind


@dataclass(frozen=True, kw_only=True)
class Outlet:
    """Where sold items are put: one spot per order, in a row from left to right as one faces them.

    middle: of the row, its yaw is the heading that faces the outlet. height: of the top [m].
    pitch: from spot to spot [m]. link: its name among those the hand may touch.
    """

    middle: Spot
    height: float
    pitch: float
    spots: int
    link: str

    def spot(self, number: int) -> Spot:
        """Return a spot; number: counted from 0."""
        return self.middle.ahead(0.0, left=self.pitch * ((self.spots - 1) / 2 - number))


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """How items are grasped.

    tip: frame of the hand, z along the approach, y along the opening. yaw: by which it is turned
    against the shelf [rad]. force [N]. opening: between the open pads [m]. depth: of the tip below
    the upper end of the body [m]; reach: how far a thing may stick into the hand beyond the tip
    [m]. width_tolerance [m]: by which a held item may be thinner than it is. down: duration of
    going down and up [s].
    """

    tip: str
    yaw: float
    force: float
    opening: float
    depth: float
    reach: float
    width_tolerance: float
    down: float


@dataclass(frozen=True, kw_only=True)
class Heights:
    """Heights of the tip [m]: look, approach, lift above the place of the grip, safe above ground.

    step: by which a carried item is lowered until the tip is no higher than safe. drop: of an item
    above the outlet where it is let go of.
    """

    look: float
    approach: float
    lift: float
    safe: float
    step: float
    drop: float


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """How far off is still good [m]; tilt [rad].

    found: of a detection from the expected place. steady: of two detections from one another.
    placed: of an item from its spot. moved: of any other item.
    """

    found: float
    steady: float
    placed: float
    moved: float
    tilt: float


@dataclass(frozen=True, kw_only=True)
class Waits:
    """Times [s]: answer of the controller, motion until it is over, camera until it shows.

    still: after a motion, before looking. rest: of all things before a place is measured, and in
    an emergency stop. halt: within which that has to come about. lost: how long an item may
    seem not to be held.
    """

    answer: float
    motion: float
    camera: float
    still: float
    rest: float
    halt: float
    lost: float


@dataclass(frozen=True, kw_only=True)
class StoreSettings:
    """All that the scenario says about the sales.

    stand: distance of the base from a shelf's front line [m]. reverse: how far it goes back from
    there before it turns [m]. tuck: joint → [rad]. carry: x, y ahead and to the left of the base
    where an item is carried [m]. base_frame: link that detections are given in.
    """

    orders: tuple[Order, ...]
    home: Spot
    shelves: Mapping[str, Spot]
    stand: float
    reverse: float
    tuck: Mapping[str, float]
    carry: tuple[float, float]
    base_frame: str
    attempts: int
    corrections: int
    looks: int
    outlet: Outlet
    grasp: Grasp
    heights: Heights
    tolerances: Tolerances
    waits: Waits
