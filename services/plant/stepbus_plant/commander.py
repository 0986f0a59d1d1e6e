"""One command input: which joints it moves, what it may ask of them, and their motors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from stepbus_schemas import JointCommand, WiringError
from stepbus_schemas.messages import JointMode

from .actuation import Actuator, Motors, make_actuator
from .errors import CommandError
from .joints import Joint
from .physics import Physics

_TAKES: Mapping[JointMode, tuple[str, ...]] = {
    "torque": (),
    "velocity": ("effort_limit",),
    "position": ("velocity", "effort_limit"),
    "teleport": (),
}
"""The optional fields of a JointCommand that each mode uses."""


class Commander:
    """Checks the commands of one input and carries them out.

    port: name of the input. joints: those it moves, in the order of its vectors. applied: torque
    applied directly to each joint [N·m]. slots: where each of `joints` stands in it. Raises
    WiringError when these joints cannot be moved by one command.
    """

    def __init__(
        self,
        *,
        port: str,
        joints: Sequence[Joint],
        physics: Physics,
        applied: list[float],
        slots: Sequence[int],
    ) -> None:
        _refuse_unmovable(port, joints)
        self._port = port
        self._joints = joints
        self._mode = joints[0].mode
        self._takes = _TAKES[self._mode]
        self._actuators = _make_actuators(physics, joints, applied, slots)
        self._active: list[Actuator] = []

    def apply(self, command: JointCommand, step: int) -> None:
        """Take in a command; it holds until the next one.

        step: for the error sentence. Raises CommandError when its mode is not the joints', or
        when a vector has a wrong length or a value that no motor can follow.
        """
        if command.mode != self._mode:
            raise CommandError(
                f"step {step}: input {self._port!r}: joint {self._joints[0].name!r} takes mode "
                f"{self._mode}, the command says {command.mode}; "
                "change the joint's mode in the world or the command"
            )
        self._check("values", command.values, step)
        if command.velocity is not None:
            self._check_optional("velocity", command.velocity, step)
        if command.effort_limit is not None:
            self._check_optional("effort_limit", command.effort_limit, step)
        for actuator in self._actuators:
            actuator.take(command)
        self._active = self._actuators

    def drive(self) -> None:
        """Set the motors for the next substep; before the first command they stay off."""
        for actuator in self._active:
            actuator.drive()

    def _check(self, field: str, vector: list[float], step: int) -> None:
        # Summing finds a value that is not finite three times faster than looking at each.
        if len(vector) == len(self._joints) and math.isfinite(sum(vector)):
            return
        if len(vector) != len(self._joints):
            names = ", ".join(joint.name for joint in self._joints)
            raise CommandError(
                f"step {step}: input {self._port!r}: {field} has {len(vector)} entries for "
                f"{len(self._joints)} joints ({names})"
            )
        for joint, value in zip(self._joints, vector, strict=True):
            if not math.isfinite(value):
                raise self._bad_value(field, joint, value, step)

    def _check_optional(self, field: str, vector: list[float], step: int) -> None:
        if field not in self._takes:
            raise CommandError(
                f"step {step}: input {self._port!r}: mode {self._mode} takes no {field}, "
                f"the command for joint {self._joints[0].name!r} has {vector[:1]}; leave it out"
            )
        self._check(field, vector, step)
        if field == "effort_limit" and min(vector) < 0:
            place = vector.index(min(vector))
            raise self._bad_value(field, self._joints[place], vector[place], step)

    def _bad_value(self, field: str, joint: Joint, value: float, step: int) -> CommandError:
        return CommandError(
            f"step {step}: input {self._port!r}: {field} of joint {joint.name!r} is {value}; "
            f"it has to be finite{' and not negative' if field == 'effort_limit' else ''}"
        )


def _make_actuators(
    physics: Physics, joints: Sequence[Joint], applied: list[float], slots: Sequence[int]
) -> list[Actuator]:
    """Return one actuator for each body and way of actuation."""
    groups: dict[tuple[int, str], list[int]] = {}
    for place, joint in enumerate(joints):
        groups.setdefault((joint.body, joint.actuation), []).append(place)
    return [
        make_actuator(
            Motors(
                physics=physics,
                joints=[joints[place] for place in places],
                places=places,
                applied=applied,
                slots=[slots[place] for place in places],
            )
        )
        for places in groups.values()
    ]


def _refuse_unmovable(port: str, joints: Sequence[Joint]) -> None:
    """Raise WiringError that names each joint a command could not move."""
    problems = [
        f"input {port!r}: joint {joint.name!r} has mode {joint.mode}, {joints[0].name!r} has "
        f"{joints[0].mode}; one command carries one mode, so give each mode an input of its own"
        for joint in joints
        if joint.mode != joints[0].mode
    ]
    problems += [
        f"input {port!r}: joint {joint.name!r} has an effort limit of 0; set 'effort' in the world"
        for joint in joints
        if joint.effort == 0 and joint.mode != "teleport"
    ]
    problems += [
        f"input {port!r}: joint {joint.name!r} has a velocity limit of 0; "
        "set 'max_velocity' in the world"
        for joint in joints
        if joint.max_velocity == 0 and joint.mode == "velocity"
    ]
    if problems:
        raise WiringError("\n".join(problems))
