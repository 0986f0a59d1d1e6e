"""The movable joints of a world: the URDF's properties, overridden by the world file's."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pybullet as bullet

from stepbus_participant import Mimic, suggest
from stepbus_plant.world import Actuation, JointSettings, OwnMode
from stepbus_schemas import Description, WiringError

_TYPES = {bullet.JOINT_REVOLUTE: "revolute", bullet.JOINT_PRISMATIC: "prismatic"}
_INSTEAD = {
    "floating": "leave it and its parent out: a body without `fixed_base` floats",
    "planar": "use two prismatic joints and a revolute one",
    "spherical": "use three revolute joints",
}
"""Type of a URDF that the plant does not support → what to use."""


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One movable joint of the world.

    name: unique in the world; `body/joint` if two bodies share it. body, index: PyBullet's
    numbers. type: revolute, continuous or prismatic. lower, upper: stops [rad]. effort: torque
    limit [N·m]. max_velocity: limit of the commanded velocity [rad/s]; 0: none. motor: a joint
    without a motor swings freely. damping: [N·m·s/rad]. friction: Coulomb friction [N·m].
    start, start_velocity: at t = 0 [rad, rad/s]. mimic: the joint of its body that it follows.
    For prismatic joints read [m] and [N] instead of [rad] and [N·m].
    """

    name: str
    body: int
    index: int
    type: str
    lower: float
    upper: float
    effort: float
    max_velocity: float
    mode: OwnMode
    motor: bool
    actuation: Actuation
    damping: float
    friction: float
    start: float
    start_velocity: float
    mimic: Mimic | None = None

    @property
    def effective_mode(self) -> str:
        """Return its mode, or `passive` if it has no motor."""
        return self.mode if self.motor else "passive"

    @property
    def is_rotary(self) -> bool:
        """Return whether its position is an angle."""
        return self.type != "prismatic"

    @property
    def unit(self) -> str:
        """Return the unit of its position."""
        return "rad" if self.is_rotary else "m"

    @property
    def effort_unit(self) -> str:
        """Return the unit of its effort."""
        return "N·m" if self.is_rotary else "N"

    def follow(self, leader: Joint, mimic: Mimic) -> Joint:
        """Return the joint as a follower of another one: without a motor, where that takes it."""
        return dataclasses.replace(
            self,
            motor=False,
            start=mimic.multiplier * leader.start + mimic.offset,
            start_velocity=mimic.multiplier * leader.start_velocity,
            mimic=mimic,
        )

    def problems(self) -> list[str]:
        """Return contradictions between the world file and the URDF."""
        problems = []
        if math.isfinite(self.lower) != math.isfinite(self.upper):
            problems.append("has no limits in its URDF; give both 'lower' and 'upper' or neither")
        elif self.lower > self.upper:
            problems.append(f"lower {self.lower} is above upper {self.upper}")
        elif not self.lower <= self.start <= self.upper:
            problems.append(
                f"start position {self.start} is outside its limits [{self.lower}, {self.upper}]"
            )
        has_motor = self.motor and (self.mode, self.actuation) != ("torque", "direct")
        if self.friction and has_motor:
            actuation = f" and actuation {self.actuation}" if self.mode == "torque" else ""
            problems.append(
                "friction needs mode torque with actuation direct, but the joint has mode "
                f"{self.mode}{actuation}"
            )
        return problems


def is_movable(info: Sequence[Any]) -> bool:
    """Return whether PyBullet's joint info describes a joint with one degree of freedom."""
    return info[2] in _TYPES


def is_fixed(info: Sequence[Any]) -> bool:
    """Return whether PyBullet's joint info describes a fixed joint."""
    return bool(info[2] == bullet.JOINT_FIXED)


def refuse_unsupported(root: Any, file: Path) -> None:
    """Raise WiringError that lists the joints of a URDF that the plant does not support."""
    rows = [(joint.get("name"), joint.get("type")) for joint in root.findall("joint")]
    lines = [
        f"{file}: joint {name!r} is {joint_type}, which is not supported; {_INSTEAD[joint_type]}"
        for name, joint_type in rows
        if joint_type in _INSTEAD
    ]
    if lines:
        raise WiringError("\n".join(lines))


def make_joint(
    body: int, info: Sequence[Any], settings: JointSettings, actuation: Actuation
) -> Joint:
    """Return a joint from PyBullet's info, overridden by the settings.

    actuation: default if the settings have none.
    """
    bounded = info[8] <= info[9]  # PyBullet marks an unlimited joint by crossed limits
    lower = _first(settings.lower, info[8] if bounded else -math.inf)
    upper = _first(settings.upper, info[9] if bounded else math.inf)
    joint_type = _TYPES[info[2]]
    return Joint(
        name=info[1].decode(),
        body=body,
        index=info[0],
        type="continuous" if joint_type == "revolute" and not bounded else joint_type,
        lower=lower,
        upper=upper,
        effort=_first(settings.effort, info[10]),
        max_velocity=_first(settings.max_velocity, info[11]),
        mode=settings.mode or "torque",
        motor=settings.motor is not False,
        actuation=settings.actuation or actuation,
        damping=settings.damping or 0.0,
        friction=settings.friction or 0.0,
        start=_first(settings.position, min(max(0.0, lower), upper)),
        start_velocity=settings.velocity or 0.0,
    )


def describe_joints(joints: Sequence[Joint]) -> Description:
    """Return their names, limits, types and modes, and the joints that some follow."""
    followed = [joint.mimic.joint if joint.mimic is not None else "" for joint in joints]
    return Description(
        names=[joint.name for joint in joints],
        limits={
            "lower": [joint.lower for joint in joints],
            "upper": [joint.upper for joint in joints],
            "velocity": [joint.max_velocity for joint in joints],
            "effort": [joint.effort for joint in joints],
        },
        details={
            "type": [joint.type for joint in joints],
            "mode": [joint.effective_mode for joint in joints],
            **({"mimic": followed} if any(followed) else {}),
        },
    )


def _first(value: float | None, default: float) -> float:
    return default if value is None else value


def name_uniquely(rows: Sequence[tuple[str, Joint]]) -> list[Joint]:
    """Return joints with unique names: `body/joint` for a name that bodies share.

    found: pairs of a body's name and a joint.
    """
    counts = Counter(joint.name for _, joint in rows)
    return [
        joint
        if counts[joint.name] == 1
        else dataclasses.replace(joint, name=f"{body}/{joint.name}")
        for body, joint in rows
    ]


def with_efforts(joints: Sequence[Joint], efforts: Mapping[str, float]) -> list[Joint]:
    """Return joints with overridden effort limits; efforts: by unique name [N·m or N].

    Raises WiringError that lists the unknown names.
    """
    names = [joint.name for joint in joints]
    mistakes = [
        f"params.effort: joint {name!r} is unknown{suggest(name, names)}"
        for name in efforts
        if name not in names
    ]
    if mistakes:
        raise WiringError("\n".join(mistakes))
    return [dataclasses.replace(j, effort=efforts.get(j.name, j.effort)) for j in joints]
