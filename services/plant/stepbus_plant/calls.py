"""Calls that query joints between two steps, or teleport one."""

import math
from collections.abc import Mapping, Sequence

from stepbus_participant import CallError, Method, suggest
from stepbus_plant.drives import Drive, locate_joints
from stepbus_plant.engine import Physics
from stepbus_plant.joint import Joint
from stepbus_plant.sensing import degrees_hint


class JointCalls:
    """Answers calls about every movable joint of the world, sensed or not, without noise.

    Angles [rad], velocities [rad/s], torques [N·m]; prismatic joints have [m, m/s, N].
    Each of its functions raises CallError for an unknown joint.
    """

    def __init__(self, physics: Physics, drives: Sequence[Drive]) -> None:
        self._physics = physics
        self._joints = {joint.name: joint for joint in physics.joints}
        self._drives = locate_joints(drives)

    def methods(self) -> Mapping[str, Method]:
        """Return every call by its name."""
        return {
            "joint_names": Method(self.names, "names of all movable joints"),
            "joint_position": Method(self.position, "NAME: true position of a joint [rad]"),
            "joint_velocity": Method(self.velocity, "NAME: true velocity of a joint [rad/s]"),
            "joint_target": Method(self.target, "NAME: target of a joint in mode position [rad]"),
            "joint_limits": Method(
                self.limits, "NAME: lower, upper [rad], velocity [rad/s], effort [N·m]"
            ),
            "set_joint_position": Method(
                self.teleport, "NAME RAD: teleports a joint, which is then at rest", changes=True
            ),
        }

    def names(self) -> list[str]:
        """Return the names of all movable joints, in the order of the world."""
        return list(self._joints)

    def position(self, name: str) -> float:
        """Return the position of a joint [rad]."""
        return self._state(name)[0]

    def velocity(self, name: str) -> float:
        """Return the velocity of a joint [rad/s]."""
        return self._state(name)[1]

    def target(self, name: str) -> float:
        """Return the latest position target of a joint [rad].

        Raises CallError if its mode has none.
        """
        joint = self._joint(name)
        drive, index = self._drives[joint.name]
        targets = drive.targets()
        if targets is None:
            raise CallError(f"joint {name} has mode {joint.effective_mode}, which has no target")
        return targets[index]

    def limits(self, name: str) -> dict[str, float | None]:
        """Return the limits of a joint; None: unlimited."""
        joint = self._joint(name)
        limits = {
            "lower": joint.lower,
            "upper": joint.upper,
            "velocity": joint.max_velocity or math.inf,
            "effort": joint.effort,
        }
        return {key: value if math.isfinite(value) else None for key, value in limits.items()}

    def teleport(self, name: str, position: float) -> None:
        """Teleport a joint to a position [rad]; a joint of mode position then holds it.

        Raises CallError for a value that is not a number or beyond a stop.
        """
        joint = self._joint(name)
        if isinstance(position, bool) or not isinstance(position, int | float):
            raise CallError(f"joint {name}: {position!r} is not a number")
        # NaN fails the comparison too.
        if not joint.lower <= position <= joint.upper or math.isinf(position):
            raise CallError(
                f"joint {name} cannot be teleported to {position:g}; its limits are "
                f"[{joint.lower:g}, {joint.upper:g}]{degrees_hint(joint, position)}"
            )
        if joint.mimic is not None:
            raise CallError(f"joint {name} follows joint {joint.mimic.joint!r}; teleport that one")
        self._physics.teleport(joint, float(position), 0.0)
        drive, index = self._drives[joint.name]
        drive.teleport(index, float(position))

    def _state(self, name: str) -> tuple[float, float]:
        joint = self._joint(name)
        position, velocity, *_ = self._physics.read(joint.body, [joint.index])[0]
        return position, velocity

    def _joint(self, name: str) -> Joint:
        if not isinstance(name, str) or name not in self._joints:
            raise CallError(f"joint {name!r} is unknown{suggest(str(name), self._joints)}")
        return self._joints[name]
