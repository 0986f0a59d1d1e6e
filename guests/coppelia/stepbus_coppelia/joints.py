"""How joints are driven, in CoppeliaSim's modes, by commands of stepbus."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.scene import Scene
from stepbus_plant.joint import Joint
from stepbus_schemas import JointCommand

FREE, FORCE, VELOCITY, POSITION, SPRING = 0, 1, 4, 8, 12
"""CoppeliaSim's `jointdynctrl_*`."""
_OWN = {"torque": FORCE, "velocity": VELOCITY, "position": POSITION}
UNREACHED = 1e4
"""Velocity that no motor reaches, so that it applies its force [rad/s]."""
HUGE = 100.0
"""From this target velocity on, a script means a torque [rad/s]."""
_GAIN = 20.0
"""From the error of a position to a velocity: CoppeliaSim's default, P = 0.1 at 5 ms [1/s]."""


@dataclass
class Control:
    """How a script drives a joint.

    mode: one of `jointdynctrl_*`. position, velocity: targets [rad, rad/s]. force: the largest, or
    in mode FORCE the one to apply [N·m]. fastest: largest velocity towards a position [rad/s].
    is_new: whether the plant has to be told.
    """

    joint: Joint
    mode: int
    position: float
    velocity: float
    force: float
    fastest: float
    is_new: bool = False

    @classmethod
    def of(cls, joint: Joint) -> "Control":
        """Return how a joint is driven before a script says anything."""
        mode = _OWN.get(joint.mode, POSITION) if joint.motor else FREE
        force = 0.0 if mode == FORCE else min(joint.effort, sys.float_info.max)
        fastest = joint.max_velocity or 2.0 * math.pi
        return cls(joint, mode, joint.start, 0.0, force, fastest)

    def drive(self, mode: int) -> None:
        """Change the mode; raises ApiError for one that the joint of the world cannot have."""
        if not self.joint.motor:
            raise ApiError(f"joint {self.joint.name} has no motor.")
        mode, has = POSITION if mode == SPRING else mode, self.joint.mode
        if mode not in (FREE, FORCE, VELOCITY, POSITION):
            raise ApiError(f"joint mode {mode} is not available in stepbus.")
        is_own = mode == _OWN.get(has) or (has == "torque" and mode in (FREE, VELOCITY))
        if has != "velocity" and not is_own:
            raise ApiError(
                f"joint {self.joint.name} has mode {has} in the world file; one of mode velocity "
                "takes every mode of CoppeliaSim."
            )
        self.mode, self.is_new = mode, True

    def torque(self) -> float:
        """Return the torque [N·m] of a joint that takes only that.

        Older scripts write it as a largest force, and a target velocity that is never reached.
        """
        if self.mode == VELOCITY and self.velocity:
            return math.copysign(self.force, self.velocity)
        return self.force if self.mode == FORCE else 0.0

    def motion(self, now: float, dt: float) -> tuple[float, float]:
        """Return target velocity and largest force of a joint of mode velocity.

        now: its position [rad]. dt: length of a step [s].
        """
        if self.mode == FREE:
            return 0.0, 0.0
        if self.mode == FORCE:
            return math.copysign(UNREACHED, self.force), abs(self.force)
        if self.mode == VELOCITY:
            return self.velocity, abs(self.force)
        wanted = min(_GAIN, 1.0 / dt) * (self.position - now)
        return max(min(wanted, self.fastest), -self.fastest), abs(self.force)


@dataclass
class Group:
    """The joints of one body that have the same mode in the world file: one port commands them."""

    names: Sequence[str]
    mode: str
    dt: float

    def command(self, controls: Mapping[str, Control], scene: Scene) -> JointCommand:
        """Return the command of all its joints, of which one is new."""
        rows, moving = [controls[name] for name in self.names], self.mode == "velocity"
        for row in rows:
            # A velocity towards a position is another one at each step.
            row.is_new = moving and row.mode == POSITION
        if self.mode == "torque":
            return JointCommand(mode="torque", values=[row.torque() for row in rows])
        pairs = [(row.position, abs(row.force)) for row in rows]
        if moving:
            places = [scene.position[scene.joint_index[name]] for name in self.names]
            pairs = [row.motion(now, self.dt) for row, now in zip(rows, places, strict=True)]
        values, forces = map(list, zip(*pairs, strict=True))
        mode: Literal["velocity", "position"] = "velocity" if moving else "position"
        return JointCommand(mode=mode, values=values, effort_limit=forces)


def groups_of(joints: Mapping[str, Joint], bodies: Sequence[str], dt: float) -> dict[str, Group]:
    """Return port → the joints that it commands: those of a body with the same mode."""
    found: dict[tuple[str, str], list[str]] = {}
    for name, joint in joints.items():
        if joint.motor and joint.mode in _OWN:
            found.setdefault((bodies[joint.body], joint.mode), []).append(name)
    names = [body for body, _ in found]
    forms = {body: "{0}" if names.count(body) == 1 else "{0}_{1}" for body in names}
    forms |= {names[0]: "command"} if len(found) == 1 else {}
    return {
        forms[body].format(body, mode): Group(rows, mode, dt)
        for (body, mode), rows in found.items()
    }
