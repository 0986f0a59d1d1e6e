"""The types of goods that a shop has, read from a world file."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from stepbus_schemas import Description, Point, Poses, Quaternion, WiringError
from stepbus_store.mission.geometry import nearest_quarter
from stepbus_store.poses import yaw_of
from stepbus_store.solids import read_solids


@dataclass(frozen=True, kw_only=True)
class Measures:
    """The dimensions of an item in the frame of its link, whose z is the vertical axis.

    width: of its body along x and y [m]. bottom, body_top, top: heights [m]; the neck of a bottle
    extends from body_top to top. is_box: whether it has flat sides.
    """

    width: tuple[float, float]
    bottom: float
    body_top: float
    top: float
    is_box: bool


@dataclass(frozen=True, kw_only=True)
class Item:
    """One item of the stock: position x, y, z [m] and yaw [rad] of its link in the world."""

    name: str
    type: str
    shelf: str
    position: Point
    yaw: float
    measures: Measures

    @property
    def bottom(self) -> float:
        """Return the height of its lower end [m]."""
        return self.position[2] + self.measures.bottom

    @property
    def top(self) -> float:
        """Return the height of its upper end [m]."""
        return self.position[2] + self.measures.top

    def width_along(self, yaw: float) -> float:
        """Return the width of its body between fingers that close along a heading [m]."""
        turn = nearest_quarter(self.yaw, yaw) - self.yaw
        is_crosswise = round(turn / (math.pi / 2)) % 2 == 1
        return self.measures.width[int(is_crosswise)]


class Stock:
    """All items, with their poses at the last inventory or update.

    description: of the plant's output of poses. shelves: their names; the item `cola_a1_3` of type
    cola is on the shelf whose name starts its slot `a1_3`. items, measures: by name. types:
    each once; all in the plant's order. Raises WiringError for an item without a known shape, and
    unless there is one type and one shape per link.
    """

    def __init__(self, description: Description, shelves: Sequence[str]) -> None:
        names, details = description.names, description.details
        types = details.get("type", [""] * len(names))
        shapes = details.get("shape", [""] * len(names))
        if {len(types), len(shapes)} != {len(names)}:
            counts = f"{len(types)} types and {len(shapes)} shapes for {len(names)} links"
            raise WiringError(
                f"the description of the poses has {counts}; they must have equal lengths"
            )
        self._index = {name: index for index, name in enumerate(names)}
        self._shelves = shelves
        self._types = {n: t for n, t in zip(names, types, strict=True) if t}
        self.types = list(dict.fromkeys(self._types.values()))
        self.measures = {name: measures(name, shapes[self._index[name]]) for name in self._types}
        self.items: dict[str, Item] = {}

    def take_inventory(self, poses: Poses) -> None:
        """Record the pose of every item."""
        for name, item_type in self._types.items():
            slot = name.removeprefix(f"{item_type}_")
            position, turn = self.pose(name, poses)
            self.items[name] = Item(
                name=name,
                type=item_type,
                shelf=next((s for s in self._shelves if slot.startswith(s)), ""),
                position=position,
                yaw=yaw_of(turn),
                measures=self.measures[name],
            )

    def pose(self, name: str, poses: Poses) -> tuple[Point, Quaternion]:
        """Return the true pose of an item."""
        index = self._index[name]
        return poses.position[index], poses.orientation[index]

    def update(self, name: str, poses: Poses) -> None:
        """Record the new pose of an item that was moved on purpose."""
        position, turn = self.pose(name, poses)
        self.items[name] = replace(self.items[name], position=position, yaw=yaw_of(turn))


def measures(name: str, shapes: str) -> Measures:
    """Return the dimensions of an item from the description of its collision shapes.

    shapes: as in `stepbus_store.solids.read_solids`.
    Raises WiringError for shapes that cannot be read, and without a box, a cylinder or a sphere.
    """
    try:
        parts = read_solids(shapes)
    except ValueError as exc:
        raise WiringError(f"item {name!r}: {exc}") from exc
    if not parts:
        raise WiringError(
            f"item {name!r} has the shape {shapes!r}; a graspable item needs a box, a cylinder or "
            "a sphere"
        )
    body = max(parts, key=lambda part: float(part.reach[0] * part.reach[1]))
    width, length, _ = (2 * body.reach).tolist()
    heights = [(float(part.position[2]), float(part.reach[2])) for part in parts]
    return Measures(
        width=(width, length),
        bottom=min(z - half for z, half in heights),
        body_top=float(body.position[2] + body.reach[2]),
        top=max(z + half for z, half in heights),
        is_box=body.type == "box",
    )
