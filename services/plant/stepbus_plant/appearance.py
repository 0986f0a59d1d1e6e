"""Colours and collision shapes of links, as text.

The engine cannot report them: it turns a cylinder into a mesh, and gives shapes relative to the
centre of mass.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stepbus_models import Link, RobotDescription, Shape
from stepbus_plant.geometry import quaternion

_ONLY_NAMED = ("mesh", "plane")


@dataclass(frozen=True)
class Appearance:
    """Collision shapes of a link in its frame, as text, and the colour of its visual."""

    shape: str = ""
    color: str = ""


def appearances(robot: RobotDescription) -> Mapping[str, Appearance]:
    """Return the appearance of each link.

    Lengths are in [m], quaternions x, y, z, w, and colours r, g, b (0 to 1).
    """
    return {
        name: Appearance("; ".join(map(_shape, link.collisions)), _color(link))
        for name, link in robot.links.items()
    }


def _shape(shape: Shape) -> str:
    size = () if shape.kind in _ONLY_NAMED else shape.size
    pose = (*shape.pose.xyz, *quaternion(shape.pose.rpy))
    return " ".join(filter(None, (shape.kind, _text(size), "@", _text(pose))))


def _color(link: Link) -> str:
    return next((_text(seen.rgba[:3]) for seen in link.visuals if seen.rgba is not None), "")


def _text(numbers: Sequence[float]) -> str:
    # Nine digits hide the last bits of sines; adding 0 removes the sign of a zero.
    return " ".join(f"{round(number, 9) + 0.0:.9g}" for number in numbers)
