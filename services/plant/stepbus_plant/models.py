"""Models that engines load, and the pairs of links that an SRDF leaves out."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

from stepbus_models import Inertial, RobotDescription, is_file
from stepbus_schemas import WiringError

_TINY = Inertial(mass=1e-6, moments=(1e-9, 1e-9, 1e-9, 0.0, 0.0, 0.0))
"""Negligible but not zero: PyBullet assumes 1 kg for a link without an inertial, and warns."""
_SAME = 1e-6
"""Stops closer than that are the same, rounded [rad or m]."""


def hindered(robot: RobotDescription) -> set[str]:
    """Return the joints with <mimic> whose own stops end before those of their leaders.

    Such a stop would fight the coupling; it ends nothing that the leader's stops do not.
    """
    joints, names = robot.joints, set()
    for name, joint in joints.items():
        mimic, lower, upper = joint.mimic, joint.lower, joint.upper
        if mimic is not None and lower is not None and upper is not None:
            leader = joints[mimic.joint]
            ends = (leader.lower, leader.upper)
            reached = [mimic.multiplier * end + mimic.offset for end in ends if end is not None]
            if not reached or min(reached) < lower - _SAME or max(reached) > upper + _SAME:
                names.add(name)
    return names


def loadable(robot: RobotDescription, loose: Collection[str] = ()) -> RobotDescription:
    """Return a robot for an engine: every link has an inertial, some joints have no stops.

    A link without an inertial is massless by the definition of URDF and gets a negligible mass.
    loose: names of these joints. Raises WiringError for missing meshes.
    """
    refuse_missing_meshes(robot)
    links = {
        name: link if link.inertial else replace(link, inertial=_TINY)
        for name, link in robot.links.items()
    }
    free = {name: replace(robot.joints[name], lower=None, upper=None) for name in loose}
    return replace(robot, links=links, joints={**robot.joints, **free})


def refuse_missing_meshes(robot: RobotDescription) -> None:
    """Raise WiringError that lists the meshes of a robot that are not there."""
    missing: dict[str, str] = {}
    for link in robot.links.values():
        for shape in (*link.visuals, *link.collisions):
            if shape.kind == "mesh" and not is_file(Path(shape.mesh)):
                text = f"link {link.name!r}: mesh {shape.mesh!r} not found"
                missing.setdefault(shape.mesh, f"{robot.place(shape.line)}: {text}")
    if missing:
        raise WiringError("\n".join(missing.values()))


def pairs_without_collision(srdf: Path) -> list[tuple[str, str]]:
    """Return the pairs of links for which an SRDF disables collisions.

    Raises WiringError if the file cannot be read.
    """
    try:
        # S314: the file is the user's own, and expat itself stops an expansion without end.
        root = ET.parse(srdf).getroot()  # noqa: S314
    except (OSError, ET.ParseError) as exc:
        raise WiringError(f"cannot read {srdf}: {exc}") from exc
    return [(e.get("link1", ""), e.get("link2", "")) for e in root.iter("disable_collisions")]
