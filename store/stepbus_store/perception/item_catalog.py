"""The items to detect: their types, colours, and the top faces that a camera sees."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stepbus_kinematics import Vector
from stepbus_schemas import Description, WiringError
from stepbus_store.perception.outlines import Disc, Outline, Rectangle
from stepbus_store.solids import Solid, read_solids

Color = tuple[float, float, float]
"""Red, green, blue, 0 to 1."""

MARGIN = 2e-3
"""A point closer to an edge may appear on either side of it [m]."""
_GRID = 4e-3
_UPRIGHT = 1.0 - 1e-3
"""Cosine of the tilt up to which a shape counts as upright."""


@dataclass(frozen=True, kw_only=True)
class Face:
    """A horizontal top face of an item.

    offset: its centre in the link's frame, x, y, z [m]. yaw: of its outline in the link's frame
    [rad].
    """

    outline: Outline
    offset: tuple[float, float, float]
    yaw: float = 0.0

    def beyond(self, points: Vector) -> Vector:
        """Return how far points in the link's frame, shape (n, 2), are outside, shape (n,) [m]."""
        return self.outline.residuals(np.array([*self.offset[:2], self.yaw]), points)[0]


@dataclass(frozen=True, kw_only=True)
class ItemType:
    """A type of item.

    faces: its top faces, highest first. centre: of the bounding box of its collision shapes, in
    the link's frame, x, y, z [m].
    """

    name: str
    color: Color
    faces: tuple[Face, ...]
    centre: tuple[float, float, float]

    def beyond(self, points: Vector) -> Vector:
        """Return how far points in the link's frame, shape (n, 3), are beside its faces [m]."""
        beyond: Vector = np.min([face.beyond(points[:, :2]) for face in self.faces], axis=0)
        return beyond

    @cached_property
    def samples(self) -> Vector:
        """Return points on its top faces that a camera above sees.

        Shape (n, 3), in the link's frame [m]; none within `MARGIN` of an edge.
        """
        samples = []
        for number, face in enumerate(self.faces):
            steps = math.ceil(face.outline.reach / _GRID)
            ticks = _GRID * np.arange(-steps, steps + 1)
            x, y = np.meshgrid(face.offset[0] + ticks, face.offset[1] + ticks)
            grid = np.column_stack([x.ravel(), y.ravel()])
            free = face.beyond(grid) < -MARGIN
            for above in self.faces[:number]:
                free &= above.beyond(grid) > MARGIN
            samples.append(np.column_stack([grid[free], np.full(free.sum(), face.offset[2])]))
        return np.concatenate(samples)


@dataclass(frozen=True, kw_only=True)
class Catalog:
    """The items that a description of Poses/1 lists.

    types: in the order of the description. others: colours of links that are not items.
    items: link → name of its type.
    """

    types: tuple[ItemType, ...]
    others: tuple[Color, ...]
    items: dict[str, str]


def read_catalog(port: str, described: Description) -> Catalog:
    """Return the catalog of items in a description of poses.

    port: its name, for messages. The first item of each type stands for all; there may be none.
    Raises WiringError for a description without types, and for invalid shapes or colours.
    """
    details = described.details
    types, count = details.get("type", []), len(described.names)
    missing = [key for key in ("type", "color", "shape") if len(details.get(key, [])) != count]
    if missing or not types:
        raise WiringError(
            f"input {port!r} describes no items: its details {', '.join(missing) or 'type'} are "
            "missing or empty; connect the poses of a plant with stock"
        )
    colors = [_color(port, name, text) for name, text in zip(types, details["color"], strict=True)]
    first = {name: types.index(name) for name in types if name}
    other = [color for name, color in zip(types, colors, strict=True) if color and not name]
    return Catalog(
        types=tuple(
            _item_type(port, name, colors[index], details["shape"][index])
            for name, index in first.items()
        ),
        others=tuple(dict.fromkeys(other)),
        items={link: name for link, name in zip(described.names, types, strict=True) if name},
    )


def with_landmarks(
    catalog: Catalog, port: str, described: Description, name: str, radius: float
) -> Catalog:
    """Return a catalog with another type, that of the landmarks: round and level.

    name: of the type; the names of their links begin with it. radius: [m]. They all have the colour
    of the first one. Raises WiringError where there are none, or where they have no colour.
    """
    links = [number for number, link in enumerate(described.names) if link.startswith(name)]
    if not links:
        raise WiringError(f"input {port!r} has no link whose name begins with {name!r}")
    color = _color(port, described.names[links[0]], described.details["color"][links[0]])
    if color is None:
        raise WiringError(f"input {port!r}: landmark {described.names[links[0]]!r} has no colour")
    face = Face(outline=Disc(radius), offset=(0.0, 0.0, 0.0))
    mark = ItemType(name=name, color=color, faces=(face,), centre=(0.0, 0.0, 0.0))
    others = tuple(other for other in catalog.others if other != color)
    return replace(catalog, types=(*catalog.types, mark), others=others)


def _color(port: str, name: str, text: str) -> Color | None:
    """Return a colour; None: none given."""
    if not text.strip():
        return None
    try:
        red, green, blue = map(float, text.split())
    except ValueError:
        red = green = blue = -1.0
    # NaN and infinity fail the comparison too.
    if not all(0 <= part < math.inf for part in (red, green, blue)):
        raise WiringError(
            f"input {port!r}: color {text!r} of {name!r} must be three numbers, `red green blue`"
        )
    return (red, green, blue)


def _item_type(port: str, name: str, color: Color | None, text: str) -> ItemType:
    if color is None or not any(color):
        raise WiringError(f"input {port!r}: item type {name!r} has no colour to detect it by")
    try:
        solids = read_solids(text)
    except ValueError as exc:
        raise WiringError(f"input {port!r}: item type {name!r}: {exc}") from exc
    faces = sorted((face for solid in solids if (face := _top(solid))), key=lambda f: -f.offset[2])
    ends = np.array([solid.position + s * solid.reach for solid in solids for s in (-1, 1)])
    middle = (ends.min(axis=0) + ends.max(axis=0)) / 2 if solids else np.zeros(3)
    x, y, z = middle.tolist()
    return ItemType(name=name, color=color, faces=tuple(faces), centre=(x, y, z))


def _top(solid: Solid) -> Face | None:
    """Return the top face of an upright box or cylinder."""
    if solid.type == "sphere" or abs(solid.axes[2, 2]) < _UPRIGHT:
        return None
    x, y, z = solid.position.tolist()
    offset = (x, y, z + solid.half[2])
    if solid.type == "cylinder":
        return Face(outline=Disc(solid.half[0]), offset=offset)
    yaw = math.atan2(solid.axes[1, 0], solid.axes[0, 0])
    return Face(outline=Rectangle(*np.multiply(solid.half[:2], 2)), offset=offset, yaw=yaw)
