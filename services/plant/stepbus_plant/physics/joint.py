"""The movable joints of a world: what their URDF says, and the world file over it."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pybullet as bullet

from stepbus_participant.settings import nearest
from stepbus_plant.world.file import Actuation, JointSettings, OwnMode
from stepbus_schemas import Description, WiringError

_KINDS = {bullet.JOINT_REVOLUTE: "revolute", bullet.JOINT_PRISMATIC: "prismatic"}
_UNSUPPORTED = {bullet.JOINT_SPHERICAL: "spherical", bullet.JOINT_PLANAR: "planar"}


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One movable joint of the world.

    name: unique in the world; `body/joint` where two bodies share it. body, index: PyBullet's
    numbers of it. kind: revolute, continuous or prismatic. lower, upper: stops [rad]. effort:
    largest torque [N·m]. max_velocity: largest commanded velocity [rad/s]; 0: any. motor: whether
    it has one; without, it swings freely. damping: [N·m·s/rad]. friction: Coulomb friction [N·m].
    start, start_velocity: at t = 0 [rad, rad/s].
    Prismatic joints have [m] and [N] in place of [rad] and [N·m].
    """

    name: str
    body: int
    index: int
    kind: str
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

    @property
    def told_mode(self) -> str:
        """Return what a description calls its mode: `passive` where it has no motor."""
        return self.mode if self.motor else "passive"

    @property
    def is_rotary(self) -> bool:
        """Return whether its position is an angle."""
        return self.kind != "prismatic"

    def mistakes(self) -> list[str]:
        """Return what cannot work, now that the URDF's part is known."""
        found = []
        if math.isfinite(self.lower) != math.isfinite(self.upper):
            found.append("has no limits in its URDF; give both 'lower' and 'upper', or none")
        elif self.lower > self.upper:
            found.append(f"lower {self.lower} is above upper {self.upper}")
        elif not self.lower <= self.start <= self.upper:
            found.append(
                f"position {self.start} at the start is outside of its limits "
                f"[{self.lower}, {self.upper}]"
            )
        has_motor = self.motor and (self.mode, self.actuation) != ("torque", "direct")
        if self.friction and has_motor:
            actuation = f" and actuation {self.actuation}" if self.mode == "torque" else ""
            found.append(
                "friction needs mode torque with actuation direct, it has mode "
                f"{self.mode}{actuation}"
            )
        return found


def is_movable(info: Sequence[Any]) -> bool:
    """Return whether PyBullet's joint info is that of a joint with one degree of freedom."""
    return info[2] in _KINDS


def is_fixed(info: Sequence[Any]) -> bool:
    """Return whether PyBullet's joint info is that of a joint that never moves."""
    return bool(info[2] == bullet.JOINT_FIXED)


def unsupported_kind(info: Sequence[Any]) -> str | None:
    """Return the kind of a joint that moves and cannot be simulated here."""
    return _UNSUPPORTED.get(info[2])


def make_joint(
    body: int, info: Sequence[Any], settings: JointSettings, actuation: Actuation
) -> Joint:
    """Return a joint from PyBullet's info of it and the settings over it.

    actuation: where the settings have none.
    """
    bounded = info[8] <= info[9]  # crossed limits are PyBullet's way of saying that there are none
    lower = _first(settings.lower, info[8] if bounded else -math.inf)
    upper = _first(settings.upper, info[9] if bounded else math.inf)
    kind = _KINDS[info[2]]
    return Joint(
        name=info[1].decode(),
        body=body,
        index=info[0],
        kind="continuous" if kind == "revolute" and not bounded else kind,
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
    """Return their names, limits, types and modes."""
    return Description(
        names=[joint.name for joint in joints],
        limits={
            "lower": [joint.lower for joint in joints],
            "upper": [joint.upper for joint in joints],
            "velocity": [joint.max_velocity for joint in joints],
            "effort": [joint.effort for joint in joints],
        },
        details={
            "type": [joint.kind for joint in joints],
            "mode": [joint.told_mode for joint in joints],
        },
    )


def _first(wanted: float | None, otherwise: float) -> float:
    return otherwise if wanted is None else wanted


def name_uniquely(found: Sequence[tuple[str, Joint]]) -> list[Joint]:
    """Return joints with unique names: `body/joint` where bodies share one.

    found: the name of its body, and the joint.
    """
    counts = Counter(joint.name for _, joint in found)
    return [
        joint
        if counts[joint.name] == 1
        else dataclasses.replace(joint, name=f"{body}/{joint.name}")
        for body, joint in found
    ]


def with_efforts(joints: Sequence[Joint], efforts: Mapping[str, float]) -> list[Joint]:
    """Return joints with other effort limits [N·m or N]; efforts: by unique name.

    Raises WiringError that lists the names that are unknown.
    """
    names = [joint.name for joint in joints]
    mistakes = [
        f"params.effort: joint {name!r} is unknown; {nearest(name, names)}"
        for name in efforts
        if name not in names
    ]
    if mistakes:
        raise WiringError("\n".join(mistakes))
    return [dataclasses.replace(j, effort=efforts.get(j.name, j.effort)) for j in joints]
