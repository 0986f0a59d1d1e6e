"""What commands ask for in vain: each cause is told once per joint, with its numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

from stepbus_plant.physics.joint import Joint
from stepbus_schemas import JointCommand

# Many a stop is a full turn, rounded up [rad].
_FULL_TURN = 2 * math.pi + 1e-3
# Two joints count as swapped when each target misses the other's place by less than this share of
# the distance between the two; nearer than the second to its own place, a target is right [rad, m].
_SWAPPED = 0.1
_LEAST_SWAP = 0.01


class Complaints:
    """Collects what a command cannot bring about, until somebody takes it.

    A cause that has been told of a joint is not told again: a controller that asks for the
    impossible asks for it at every step.
    """

    def __init__(self) -> None:
        self._told: set[tuple[str, str]] = set()
        self._new: list[str] = []

    def add(self, subject: str, cause: str, text: str) -> None:
        """Tell one thing, unless this cause has been told of this subject already."""
        if (subject, cause) not in self._told:
            self._told.add((subject, cause))
            self._new.append(f"{subject}: {text}")

    def take(self) -> list[str]:
        """Return what has come since the last call, a sentence each."""
        new, self._new = self._new, []
        return new

    def check(self, joints: Sequence[Joint], command: JointCommand) -> None:
        """Take in whatever of a command cannot take effect; its vectors fit the joints."""
        limits = command.effort_limit
        for place, joint in enumerate(joints):
            value = command.values[place]
            effort = joint.effort if limits is None else min(joint.effort, limits[place])
            if not joint.motor:
                self._add(joint, "motor", "has no motor (world file: motor: false); it swings free")
            elif command.mode == "torque":
                self._check_torque(joint, value)
            elif effort == 0.0:
                self._add(joint, "effort", "has an effort limit of 0 N·m; nothing moves it")
            elif command.mode == "position":
                self._check_target(joint, value)
                if command.velocity is not None:
                    self._check_pace(joint, command.velocity[place])
            elif 0 < joint.max_velocity < abs(value):
                text = f"{value:g} rad/s is beyond its limit of {joint.max_velocity:g}; cut there"
                self._add(joint, "velocity", text)

    def _check_torque(self, joint: Joint, value: float) -> None:
        if abs(value) > joint.effort:
            text = f"{value:g} N·m is beyond its limit of {joint.effort:g}; cut there"
            self._add(joint, "torque", text)

    def _check_target(self, joint: Joint, value: float) -> None:
        if not joint.lower <= value <= joint.upper:
            stop = joint.lower if value < joint.lower else joint.upper
            unit = "rad" if joint.is_rotary else "m"
            text = f"target {value:g} {unit} is beyond its stop at {stop:g}; cut there"
            hint = degrees_hint(joint, value)
            # A sinusoid in degrees begins within a turn: the hint shall come all the same.
            self._add(joint, "turn" if hint else "stop", text + hint)
        elif hint := degrees_hint(joint, value):
            self._add(joint, "turn", f"target {value:g} rad is more than a full turn{hint}")

    def _check_pace(self, joint: Joint, velocity: float) -> None:
        # A thousandth more is a rounding error of somebody who goes as fast as he may.
        if 0 < 1.001 * joint.max_velocity < abs(velocity):
            unit = "rad/s" if joint.is_rotary else "m/s"
            text = f"its target moves at {velocity:g} {unit}, its limit is {joint.max_velocity:g}"
            self._add(joint, "pace", f"{text}; it falls behind")

    def check_start(
        self, joints: Sequence[Joint], positions: Sequence[float], targets: Sequence[float]
    ) -> None:
        """Tell of pairs whose first targets are each where the other one of the two stands.

        positions, targets: shape (n,), [rad]. A target that is far off is no mistake by itself.
        """
        rows = list(zip(joints, positions, targets, strict=True))
        away = [row for row in rows if abs(row[2] - row[1]) > _LEAST_SWAP]
        for (one, at_one, to_one), (two, at_two, to_two) in combinations(away, 2):
            close = _SWAPPED * abs(at_one - at_two)
            if abs(to_one - at_two) <= close and abs(to_two - at_one) <= close:
                unit = "rad" if one.is_rotary else "m"
                self.add(
                    f"joints {one.name} and {two.name}",
                    "swapped",
                    f"are at {at_one:g} and {at_two:g} {unit}, their first targets are {to_one:g} "
                    f"and {to_two:g}; are the two swapped?",
                )

    def _add(self, joint: Joint, cause: str, text: str) -> None:
        self.add(f"joint {joint.name}", cause, text)


def degrees_hint(joint: Joint, position: float) -> str:
    """Return the end of a sentence where a position looks like degrees given for radians."""
    if not joint.is_rotary or not _FULL_TURN < abs(position) < math.inf:
        return ""
    return f"; is it in degrees? {position:g}° are {math.radians(position):.4f} rad"
