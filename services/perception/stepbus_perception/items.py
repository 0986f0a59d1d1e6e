"""What there is to find: kinds of items, their colours, and their tops that a camera sees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stepbus_schemas import Description, WiringError

from .detection.outlines import Disc, Outline, Rectangle
from .geometry import Pose, Vector, rotation

MARGIN = 2e-3
"""Points nearer to an edge may be seen on either side of it [m]."""
_GRID = 4e-3
_SIZES = {"box": 3, "cylinder": 2, "sphere": 1, "mesh": 0}
"""How many numbers follow the name of a shape."""
_UPRIGHT = 1.0 - 1e-3
"""Cosine of the tilt up to which a shape counts as standing upright."""


@dataclass(frozen=True, kw_only=True)
class Face:
    """A horizontal top of an item.

    offset: its centre in the link's frame, x, y, z [m]. yaw: of its outline against the link
    [rad].
    """

    outline: Outline
    offset: tuple[float, float, float]
    yaw: float = 0.0

    def beyond(self, points: Vector) -> Vector:
        """Return how far points in the link's frame, shape (n, 2), are outside, shape (n,) [m]."""
        return self.outline.residuals(np.array([*self.offset[:2], self.yaw]), points)[0]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of item.

    color: red, green, blue, 0 to 1. faces: its tops, the highest first. centre: of the box around
    its collision shapes, in the link's frame, x, y, z [m].
    """

    name: str
    color: tuple[float, float, float]
    faces: tuple[Face, ...]
    centre: tuple[float, float, float]

    @cached_property
    def samples(self) -> Vector:
        """Return points all over its tops, as a camera above would see them.

        Shape (n, 3), in the link's frame [m]; none within `MARGIN` of an edge.
        """
        rows = []
        for number, face in enumerate(self.faces):
            grid = _grid(face)
            free = face.beyond(grid) < -MARGIN
            for above in self.faces[:number]:
                free &= above.beyond(grid) > MARGIN
            rows.append(np.column_stack([grid[free], np.full(free.sum(), face.offset[2])]))
        return np.concatenate(rows)


@dataclass(frozen=True, kw_only=True)
class Goods:
    """What the description of a Poses/1 tells about the items.

    kinds: in the order of the description. others: colours of links that are no items.
    items: link → kind.
    """

    kinds: tuple[Kind, ...]
    others: tuple[tuple[float, float, float], ...]
    items: dict[str, str]


def read_goods(port: str, described: Description) -> Goods:
    """Return the kinds of items that a description of poses tells of.

    port: its name, for messages. Items of one kind are alike; the first of each is looked at.
    There may be none: an empty store is one, too. Raises WiringError for a description that has no
    kinds at all, or shapes or colours that cannot be read.
    """
    details = described.details
    kinds, count = details.get("type", []), len(described.names)
    missing = [key for key in ("type", "color", "shape") if len(details.get(key, [])) != count]
    if missing or not kinds:
        raise WiringError(
            f"input {port!r} describes no items: its details {', '.join(missing) or 'kind'} are "
            "missing or empty; connect the poses of a plant with stock"
        )
    first = {kind: kinds.index(kind) for kind in kinds if kind}
    colors = [_color(port, name, text) for name, text in zip(kinds, details["color"], strict=True)]
    return Goods(
        kinds=tuple(
            _kind(port, kind, colors[at], details["shape"][at]) for kind, at in first.items()
        ),
        others=tuple(
            dict.fromkeys(
                color for kind, color in zip(kinds, colors, strict=True) if color and not kind
            )
        ),
        items={name: kind for name, kind in zip(described.names, kinds, strict=True) if kind},
    )


def _grid(face: Face) -> Vector:
    """Return a square grid, shape (n, 2), wide enough for a face."""
    steps = math.ceil(face.outline.reach / _GRID)
    ticks = _GRID * np.arange(-steps, steps + 1)
    x, y = np.meshgrid(face.offset[0] + ticks, face.offset[1] + ticks)
    return np.column_stack([x.ravel(), y.ravel()])


def _color(port: str, name: str, text: str) -> tuple[float, float, float] | None:
    numbers = _numbers(port, name, text.split())
    if not numbers:
        return None
    if len(numbers) != 3 or min(numbers) < 0:
        raise WiringError(f"input {port!r}: color {text!r} of {name!r} is not `red green blue`")
    return (numbers[0], numbers[1], numbers[2])


def _numbers(port: str, name: str, words: Sequence[str]) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = [math.nan]
    if not all(map(math.isfinite, numbers)):
        text = f"{' '.join(words)!r} of {name!r} is not a list of finite numbers"
        raise WiringError(f"input {port!r}: {text}")
    return numbers


@dataclass(frozen=True, kw_only=True)
class _Part:
    """A collision shape: half its lengths and where it is, in the link's frame [m]."""

    word: str
    half: tuple[float, float, float]
    at: Pose

    @property
    def reach(self) -> Vector:
        """Return half the box around it, along the link's axes, shape (3,) [m]."""
        reach: Vector = np.abs(self.at.rotation) @ self.half
        return reach

    @property
    def face(self) -> Face | None:
        """Return its top, where it is a box or a cylinder that stands upright."""
        axes = self.at.rotation
        if self.word == "sphere" or abs(axes[2, 2]) < _UPRIGHT:
            return None
        x, y, z = self.at.position.tolist()
        offset = (x, y, z + self.half[2])
        if self.word == "cylinder":
            return Face(outline=Disc(self.half[0]), offset=offset)
        yaw = math.atan2(axes[1, 0], axes[0, 0])
        return Face(outline=Rectangle(*np.multiply(self.half[:2], 2)), offset=offset, yaw=yaw)


def _kind(port: str, name: str, color: tuple[float, float, float] | None, shapes: str) -> Kind:
    if color is None or not any(color):
        raise WiringError(f"input {port!r}: kind {name!r} has no colour to look for")
    texts = [text.strip() for text in shapes.split(";")]
    parts = [part for text in texts if text and (part := _part(port, name, text))]
    faces = sorted((face for part in parts if (face := part.face)), key=lambda f: -f.offset[2])
    ends = np.array([part.at.position + s * part.reach for part in parts for s in (-1, 1)])
    middle = (ends.min(axis=0) + ends.max(axis=0)) / 2 if parts else np.zeros(3)
    x, y, z = middle.tolist()
    return Kind(name=name, color=color, faces=tuple(faces), centre=(x, y, z))


def _part(port: str, kind: str, text: str) -> _Part | None:
    """Return one shape; None for a mesh."""
    shape, _, place = text.partition("@")
    word, *words = shape.split() or [""]
    sizes = _numbers(port, kind, words)
    at = _numbers(port, kind, place.split()) or [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    is_sized = _SIZES.get(word) == len(sizes) and min(sizes, default=1.0) > 0
    if len(at) != 7 or not any(at[3:]) or not is_sized:
        raise WiringError(f"input {port!r}: shape {text!r} of kind {kind!r} cannot be read")
    if word == "mesh":
        return None
    x, y, z = sizes if word == "box" else (2 * sizes[0], 2 * sizes[0], sizes[-1])
    if word == "sphere":
        z = x
    pose = Pose(rotation=rotation(at[3:]), position=np.array(at[:3]))
    return _Part(word=word, half=(x / 2, y / 2, z / 2), at=pose)
