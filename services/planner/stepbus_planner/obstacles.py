"""The things around the robot, as the plant describes them, and where they are."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from stepbus_participant.settings import nearest
from stepbus_schemas import Description, Poses, RunError, WiringError

_SHAPES: Mapping[str, tuple[int, Callable[..., Any]]] = {
    "box": (3, coal.Box),
    "capsule": (2, coal.Capsule),
    "cylinder": (2, coal.Cylinder),
    "sphere": (1, coal.Sphere),
}
"""Word → how many sizes follow it [m], and what makes the shape of them."""


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A convex shape, and where it is in its link."""

    geometry: Any
    placement: Any


@dataclass(frozen=True, kw_only=True)
class Link:
    """A link of the world; place: its place in Poses; shapes: empty for one that has none."""

    name: str
    place: int
    shapes: tuple[Shape, ...]


class World:
    """All links that are not the robot's.

    described: of the input Poses/1: `names`, and `details` with `shape` and `body` per link, see
    docs/world.md. frame: a link of the robot; poses are returned in it. unseen: names of links
    of which not all shapes are known: meshes and planes.
    Raises WiringError with what is missing or cannot be read.
    """

    def __init__(self, port: str, described: Description, frame: str) -> None:
        names, details = described.names, described.details
        lacking = [key for key in ("shape", "body") if len(details.get(key, ())) != len(names)]
        if lacking or frame not in names:
            problems = [
                f"input {port!r} does not describe the {key} of its links" for key in lacking
            ]
            if frame not in names:
                problems.append(f"input {port!r} has no link {frame!r}; {nearest(frame, names)}")
            raise WiringError("\n".join(problems))
        self._port = port
        self._places = {name: k for k, name in enumerate(names)}
        self._frame = names.index(frame)
        own = details["body"][self._frame]
        rows = zip(names, details["shape"], details["body"], strict=True)
        others = [(k, name, text) for k, (name, text, body) in enumerate(rows) if body != own]
        self.unseen = [name for _, name, text in others if not all(map(_is_known, _split(text)))]
        self.links = {
            name: Link(name=name, place=k, shapes=_read_shapes(port, name, text))
            for k, name, text in others
        }

    def check(self, poses: Poses) -> None:
        """Raise RunError for poses of another number of links, or one that is no pose."""
        names, counts = list(self._places), {len(poses.position), len(poses.orientation)}
        if counts != {len(names)}:
            came = f"{len(poses.position)} positions and {len(poses.orientation)} orientations"
            raise RunError(f"input {self._port!r}: {len(names)} poses expected, {came} came")
        rows = zip(names, poses.position, poses.orientation, strict=True)
        for name, position, turn in rows:
            if not (math.isfinite(sum(position)) and 0.0 < math.hypot(*turn) < math.inf):
                text = f"{position}, {turn} of {name} is no pose"
                raise RunError(f"input {self._port!r}: {text}")

    def placements(self, poses: Poses) -> dict[str, Any]:
        """Return the pose of each link in `frame`, as `pinocchio.SE3`."""
        base = _pose(poses, self._frame).inverse()
        return {name: base * _pose(poses, link.place) for name, link in self.links.items()}

    def place_of(self, name: str) -> int | None:
        """Return the place of a link in Poses, the robot's own too; None: there is none."""
        return self._places.get(name)

    def placement(self, poses: Poses, place: int) -> Any:
        """Return the pose of one link in `frame`, as `pinocchio.SE3`."""
        return _pose(poses, self._frame).inverse() * _pose(poses, place)

    def base_moved(self, before: Poses, now: Poses) -> float:
        """Return how far the robot's `frame` has moved from one time to another [m]."""
        was, there = before.position[self._frame], now.position[self._frame]
        return float(np.linalg.norm(np.subtract(there, was)))


def _pose(poses: Poses, place: int) -> Any:
    return _placement(np.array([*poses.position[place], *poses.orientation[place]]))


def _placement(numbers: Any) -> Any:
    """Return the SE3 of x, y, z and a quaternion x, y, z, w of about length 1."""
    turned = pin.Quaternion(numbers[3:].copy())
    turned.normalize()
    return pin.SE3(turned, numbers[:3].copy())


def _read_shapes(port: str, name: str, text: str) -> tuple[Shape, ...]:
    return tuple(_read_shape(port, name, part) for part in filter(_is_known, _split(text)))


def _split(text: str) -> list[str]:
    return [part.strip() for part in text.split(";") if part.strip()]


def _is_known(part: str) -> bool:
    return part.split(maxsplit=1)[0] in _SHAPES


def _read_shape(port: str, name: str, text: str) -> Shape:
    """Return the shape that a text such as `sphere 0.1 @ 0 0 0 0 0 0 1` describes."""
    form, _, at = text.partition("@")
    word, *sizes = form.split()
    count, make = _SHAPES[word]
    numbers, pose = _numbers(sizes), _numbers(at.split())
    if len(numbers) != count or len(pose) != 7 or min(numbers) <= 0:
        raise WiringError(f"input {port!r}: link {name!r} has shape {text!r}, which is none")
    geometry = make(*numbers)
    geometry.computeLocalAABB()
    return Shape(geometry=geometry, placement=_placement(np.array(pose)))


def _numbers(words: list[str]) -> list[float]:
    """Return words as finite numbers; fewer where one is none."""
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return []
    return [number for number in numbers if math.isfinite(number)]
