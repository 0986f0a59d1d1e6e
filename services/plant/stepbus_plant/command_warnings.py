"""Warnings about commands that cannot take effect: each cause once per joint, with its numbers."""

from collections.abc import Iterator, Sequence

from stepbus_plant.joint import Joint
from stepbus_schemas import JointCommand


class Warnings:
    """Collects warnings about commands until they are taken.

    Each cause is reported once per subject: a controller that commands the impossible does so at
    every step. reported: (subject, cause). pending: those since the last call of `take`.
    """

    def __init__(self) -> None:
        self.reported: set[tuple[str, str]] = set()
        self.pending: list[str] = []

    def add(self, subject: str, cause: str, text: str) -> None:
        """Add a warning, unless this cause has been reported for this subject."""
        if (subject, cause) not in self.reported:
            self.reported.add((subject, cause))
            self.pending.append(f"{subject}: {text}")

    def take(self) -> list[str]:
        """Return the warnings since the last call, one sentence each."""
        new, self.pending = self.pending, []
        return new

    def check(self, joints: Sequence[Joint], command: JointCommand) -> None:
        """Warn about each part of a command that cannot take effect; its vectors fit the joints."""
        for index, joint in enumerate(joints):
            for cause, text in _without_effect(joint, command, index):
                self.add(f"joint {joint.name}", cause, text)


def _without_effect(joint: Joint, command: JointCommand, index: int) -> Iterator[tuple[str, str]]:
    """Yield cause and sentence of what cannot take effect; index: of the joint in the command."""
    value, limits = command.values[index], command.effort_limit
    if joint.mimic is not None:
        leader = joint.mimic.joint
        yield "mimic", f"follows joint {leader!r} (<mimic> of its URDF); command that joint instead"
    elif not joint.motor:
        yield "motor", "has no motor (world file: motor: false); it swings freely"
    elif command.mode == "torque":
        if abs(value) > joint.effort:
            text = f"{value:g} {joint.effort_unit} exceeds its limit of {joint.effort:g}"
            yield "torque", f"{text}; limited to it"
    elif joint.effort == 0.0 or (limits is not None and limits[index] <= 0.0):
        yield "effort", f"has an effort limit of 0 {joint.effort_unit}; nothing moves it"
    elif command.mode == "position":
        if (stop := joint.within_stops(value)) != value:
            text = f"target {value:g} {joint.unit} is beyond its stop at {stop:g}"
            yield "stop", f"{text}; limited to it"
        velocity = 0.0 if command.velocity is None else command.velocity[index]
        # Tolerate the rounding error of a sender that moves exactly at the limit.
        if 0 < 1.001 * joint.max_velocity < abs(velocity):
            text = f"its target moves at {velocity:g} {joint.unit}/s, its limit is "
            yield "target velocity", f"{text}{joint.max_velocity:g}; it falls behind"
    elif 0 < joint.max_velocity < abs(value):
        text = f"{value:g} {joint.unit}/s exceeds its limit of {joint.max_velocity:g}"
        yield "velocity", f"{text}; limited to it"
