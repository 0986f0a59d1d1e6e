"""What the plant can be asked between two steps, and the one thing it can be told to do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from stepbus_participant.calls import CallError, Verb
from stepbus_participant.settings import nearest
from stepbus_plant.physics.engine import Physics
from stepbus_plant.physics.joint import Joint

from .drives import Drive
from .warnings import degrees_hint


class Questions:
    """Answers calls about every movable joint of the world, sensed or not, and without noise.

    Angles [rad], velocities [rad/s], torques [N·m]; prismatic joints have [m, m/s, N].
    Each of its functions raises CallError for a joint that there is not.
    """

    def __init__(self, physics: Physics, drives: Sequence[Drive]) -> None:
        self._physics = physics
        self._joints = {joint.name: joint for joint in physics.joints}
        self._drives = {j.name: (drive, i) for drive in drives for i, j in enumerate(drive.joints)}

    def verbs(self) -> Mapping[str, Verb]:
        """Return every question by its name."""
        return {
            "joint_names": Verb(self.names, "names of all movable joints"),
            "joint_position": Verb(self.position, "NAME: where a joint truly is [rad]"),
            "joint_velocity": Verb(self.velocity, "NAME: how fast a joint truly moves [rad/s]"),
            "joint_target": Verb(self.target, "NAME: where a joint of mode position goes to [rad]"),
            "joint_limits": Verb(
                self.limits, "NAME: lower, upper [rad], velocity [rad/s], effort [N·m]"
            ),
            "set_joint_position": Verb(
                self.put, "NAME RAD: teleports a joint, which is then at rest", changes=True
            ),
        }

    def names(self) -> list[str]:
        """Return the names of all movable joints, in the order of the world."""
        return list(self._joints)

    def position(self, name: str) -> float:
        """Return where a joint is [rad]."""
        return self._state(name)[0]

    def velocity(self, name: str) -> float:
        """Return how fast a joint moves [rad/s]."""
        return self._state(name)[1]

    def target(self, name: str) -> float:
        """Return the newest position target of a joint [rad].

        Raises CallError where its mode has none.
        """
        joint = self._joint(name)
        drive, place = self._drives[joint.name]
        targets = drive.targets()
        if targets is None:
            raise CallError(f"joint {name} has mode {joint.told_mode}, which has no target")
        return targets[place]

    def limits(self, name: str) -> dict[str, float | None]:
        """Return the limits of a joint by name; None: there is no such limit."""
        joint = self._joint(name)
        rows = {
            "lower": joint.lower,
            "upper": joint.upper,
            "velocity": joint.max_velocity or math.inf,
            "effort": joint.effort,
        }
        return {key: value if math.isfinite(value) else None for key, value in rows.items()}

    def put(self, name: str, position: float) -> None:
        """Teleport a joint to a position [rad]; a joint of mode position then holds there.

        Raises CallError for what is no number or beyond its stops.
        """
        joint = self._joint(name)
        if isinstance(position, bool) or not isinstance(position, int | float):
            raise CallError(f"joint {name}: {position!r} is no number")
        # Not a number is within no stops either.
        if not joint.lower <= position <= joint.upper or math.isinf(position):
            raise CallError(
                f"joint {name} cannot be put at {position:g}; its limits are "
                f"[{joint.lower:g}, {joint.upper:g}]{degrees_hint(joint, position)}"
            )
        self._physics.put(joint, float(position), 0.0)
        drive, place = self._drives[joint.name]
        drive.jumped(place, float(position))

    def _state(self, name: str) -> tuple[float, float]:
        joint = self._joint(name)
        row = self._physics.read(joint.body, [joint.index])[0]
        return row[0], row[1]

    def _joint(self, name: str) -> Joint:
        if not isinstance(name, str) or name not in self._joints:
            raise CallError(f"joint {name!r} is unknown; {nearest(str(name), self._joints)}")
        return self._joints[name]
