"""What stands on the shelves: kinds, places and measures, as the plant tells them at the start."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from stepbus_schemas import Description, Poses, RunError, WiringError
from stepbus_schemas.messages import Point, Quaternion

from .geometry import distance, extents, nearest_quarter, yaw_of

_AT_ORIGIN = "0 0 0 0 0 0 1"


@dataclass(frozen=True, kw_only=True)
class Measures:
    """The size of an item, in the frame of its link.

    width: of its body along x and y [m]. bottom, body_top, top: heights [m]; the neck of a bottle
    reaches from body_top to top. is_box: whether it has sides. The link's z is its axis.
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
    kind: str
    shelf: str
    position: Point
    yaw: float
    measures: Measures

    @property
    def bottom(self) -> float:
        """Return the height of what it stands on [m]."""
        return self.position[2] + self.measures.bottom

    @property
    def top(self) -> float:
        """Return the height of its upper end [m]."""
        return self.position[2] + self.measures.top

    @property
    def body_top(self) -> float:
        """Return the height of the upper end of its body, without its neck [m]."""
        return self.position[2] + self.measures.body_top

    def width_along(self, yaw: float) -> float:
        """Return the width of its body between pads that close along a heading [m]."""
        turned = nearest_quarter(self.yaw, yaw) - self.yaw
        is_crosswise = round(turned / (math.pi / 2)) % 2 == 1
        return self.measures.width[int(is_crosswise)]


class Stock:
    """All items, where they stood at the stock-taking or were put since, and where they are now.

    description: of the plant's output of poses. shelves: their names; an item `cola_a1_3` of kind
    cola stands on the shelf whose name its place `a1` begins with.
    Raises WiringError for an item without a shape that can be measured, and where kinds or shapes
    are not one per link.
    """

    def __init__(self, description: Description, shelves: Sequence[str]) -> None:
        names, details = description.names, description.details
        kinds = details.get("type", [""] * len(names))
        shapes = details.get("shape", [""] * len(names))
        if {len(kinds), len(shapes)} != {len(names)}:
            counts = f"{len(kinds)} kinds and {len(shapes)} shapes for {len(names)} links"
            raise WiringError(f"the poses are described with {counts}")
        self._index = {name: place for place, name in enumerate(names)}
        self._shelves = shelves
        self._kinds = {n: k for n, k in zip(names, kinds, strict=True) if k}
        self._measures = {
            name: measures(name, shape)
            for name, kind, shape in zip(names, kinds, shapes, strict=True)
            if kind
        }
        self._items: dict[str, Item] = {}

    @property
    def items(self) -> Mapping[str, Item]:
        """Return all items by name, in the plant's order, as they stood when last looked at."""
        return self._items

    @property
    def kinds(self) -> list[str]:
        """Return every kind once, in the plant's order."""
        return list(dict.fromkeys(self._kinds.values()))

    @property
    def names(self) -> list[str]:
        """Return the names of all items, in the plant's order."""
        return list(self._kinds)

    def check(self, poses: Poses) -> None:
        """Raise RunError for poses of another number of links, or of an item that is nowhere."""
        counts = {len(poses.position), len(poses.orientation)}
        if counts != {len(self._index)}:
            raise RunError(f"{len(self._index)} poses expected, {len(poses.position)} came")
        for name in self._kinds:
            position, turn = self.pose(name, poses)
            if not math.isfinite(sum(position) + sum(turn)):
                raise RunError(f"{name} is at {position}, turned by {turn}: that is no pose")

    def take(self, poses: Poses) -> None:
        """Take stock: note where every item stands."""
        self._items = {name: self._item(name, kind, poses) for name, kind in self._kinds.items()}

    def _item(self, name: str, kind: str, poses: Poses) -> Item:
        place = name.removeprefix(f"{kind}_")
        position, turn = self.pose(name, poses)
        return Item(
            name=name,
            kind=kind,
            shelf=next((s for s in self._shelves if place.startswith(s)), ""),
            position=position,
            yaw=yaw_of(turn),
            measures=self._measures[name],
        )

    def pose(self, name: str, poses: Poses) -> tuple[Point, Quaternion]:
        """Return where an item is now, in truth."""
        at = self._index[name]
        return poses.position[at], poses.orientation[at]

    def put(self, name: str, poses: Poses) -> None:
        """Note that an item stands elsewhere from now on, with good reason."""
        position, turn = self.pose(name, poses)
        self._items[name] = replace(self._items[name], position=position, yaw=yaw_of(turn))

    def largest_move(self, poses: Poses, besides: str = "") -> tuple[float, str]:
        """Return how far the item has moved that has moved most [m], and its name.

        besides: the item that is meant to move. An empty name: there is no other item.
        """
        moves = (
            (distance(item.position, self.pose(name, poses)[0]), name)
            for name, item in self._items.items()
            if name != besides
        )
        return max(moves, key=lambda move: move[0], default=(0.0, ""))


def measures(name: str, shapes: str) -> Measures:
    """Return the size of an item out of the description of its collision shapes.

    shapes: `box X Y Z`, `cylinder RADIUS LENGTH` or `sphere RADIUS`, each followed by
    ` @ x y z qx qy qz qw` in the frame of the link; several are joined by `; `.
    Raises WiringError where none of them can be measured.
    """
    parts = [part for text in shapes.split(";") if (part := _part(text.strip())) is not None]
    if not parts:
        raise WiringError(
            f"item {name!r} has the shape {shapes!r}; to be grasped it needs a box, a cylinder or "
            "a sphere"
        )
    body = max(parts, key=lambda part: part.size[0] * part.size[1])
    return Measures(
        width=(body.size[0], body.size[1]),
        bottom=min(part.at[2] - part.size[2] / 2 for part in parts),
        body_top=body.at[2] + body.size[2] / 2,
        top=max(part.at[2] + part.size[2] / 2 for part in parts),
        is_box=body.is_box,
    )


@dataclass(frozen=True)
class _Part:
    """One shape: how far it reaches along x, y, z, and its centre [m]."""

    size: Point
    at: Point
    is_box: bool


def _part(text: str) -> _Part | None:
    """Return one shape; None for one that has no measures."""
    shape, _, pose = text.partition("@")
    kind, *words = shape.split() or [""]
    try:
        size = _SIZES[kind](*(float(word) for word in words))
        x, y, z, qx, qy, qz, qw = (float(word) for word in (pose or _AT_ORIGIN).split())
    except (KeyError, TypeError, ValueError):
        return None
    if not (min(size) > 0.0 and math.isfinite(sum((*size, x, y, z, qx, qy, qz, qw)))):
        return None
    return _Part(extents(size, (qx, qy, qz, qw)), (x, y, z), kind == "box")


def _box(x: float, y: float, z: float) -> Point:
    return (x, y, z)


def _cylinder(radius: float, length: float) -> Point:
    return (2 * radius, 2 * radius, length)


def _sphere(radius: float) -> Point:
    return (2 * radius, 2 * radius, 2 * radius)


_SIZES: dict[str, Callable[..., Point]] = {"box": _box, "cylinder": _cylinder, "sphere": _sphere}
