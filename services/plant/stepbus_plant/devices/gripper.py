"""A gripper with two coupled fingers: width, force, and whether it holds something."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pybullet as bullet

from stepbus_plant.errors import CommandError
from stepbus_plant.joints.commander import Commander
from stepbus_plant.joints.warnings import Complaints
from stepbus_plant.physics.engine import Physics
from stepbus_plant.physics.joint import Joint, describe_joints
from stepbus_plant.world.file import GripperRow
from stepbus_schemas import Description, GripperCommand, GripperState, JointCommand

from .poses import Place

# How fast the last of the way is closed; below it the fingers slow down [1/s].
_GAIN = 10.0

# Of the cosine between a finger's push and the direction in which the fingers open: 45°.
_SQUEEZES = math.sqrt(0.5)


@dataclass(frozen=True)
class _Push:
    """All that one finger presses on one thing: force [N], and the directions ± of its points."""

    force: float
    directions: list[Sequence[float]]


class Gripper:
    """Two prismatic fingers that open by positive positions, and move alike.

    width: the sum of both positions [m].
    """

    def __init__(self, row: GripperRow, left: Joint, right: Joint, physics: Physics) -> None:
        self.joints = (left, right)
        self.speed = row.speed
        self.max_force = min(left.effort, right.effort)
        self.widths = (left.lower + right.lower, left.upper + right.upper)
        self._body = left.body
        self._fingers = [left.index, right.index]
        self._physics = physics
        self._slide = bullet.getJointInfo(left.body, left.index, physics.client)[13]
        self._couple()

    def _couple(self) -> None:
        """Let the engine keep both positions equal; uncoupled fingers drift with what they hold."""
        client = self._physics.client
        left, right = self._fingers
        zero = (0.0, 0.0, 0.0)
        gear = bullet.createConstraint(
            self._body,
            left,
            self._body,
            right,
            bullet.JOINT_GEAR,
            jointAxis=(1.0, 0.0, 0.0),
            parentFramePosition=zero,
            childFramePosition=zero,
            physicsClientId=client,
        )
        bullet.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=100, physicsClientId=client)

    def width(self) -> float:
        """Return how far the fingers are apart now [m]."""
        left, right = self._physics.read(self._body, self._fingers)
        width: float = left[0] + right[0]
        return width

    def describe(self) -> Description:
        """Return names and limits of its fingers."""
        return describe_joints(self.joints)

    def sense(self) -> GripperState:
        """Return width and force now, and whether something is held.

        The force is that of the weaker finger, which is what squeezes. What the other one has
        beyond it pushes the thing aside, until the fingers have centred it.
        """
        left, right = (self._pushes(finger) for finger in self._fingers)
        force = min(sum(push.force for push in side.values()) for side in (left, right))
        held = [(push, right[thing]) for thing, push in left.items() if thing in right]
        axis = self._axis() if held else ()
        holding = any(all(_is_along(axis, push) for push in pushes) for pushes in held)
        return GripperState(width=self.width(), force=force, holding=holding)

    def _axis(self) -> Sequence[float]:
        """Return the direction in which the fingers open, in the frame of the world."""
        client = self._physics.client
        state = bullet.getLinkState(
            self._body, self._fingers[0], computeForwardKinematics=True, physicsClientId=client
        )
        axis: Sequence[float] = bullet.rotateVector(state[5], self._slide)
        return axis

    def _pushes(self, finger: int) -> dict[Place, _Push]:
        """Return what a finger presses on, other than its own body."""
        points = bullet.getContactPoints(
            bodyA=self._body, linkIndexA=finger, physicsClientId=self._physics.client
        )
        groups: dict[Place, list[Sequence[Any]]] = {}
        for point in points:
            if point[9] > 0.0 and point[2] != self._body:
                groups.setdefault((point[2], point[4]), []).append(point)
        return {thing: _sum(group) for thing, group in groups.items()}


def _sum(points: Sequence[Sequence[Any]]) -> _Push:
    return _Push(sum(point[9] for point in points), [point[7] for point in points])


def _is_along(axis: Sequence[float], push: _Push) -> bool:
    """Return whether a finger squeezes, instead of resting on what it presses on.

    One point is enough: PyBullet keeps the direction of older ones while hand and thing turn
    together. Its sign is PyBullet's own choice.
    """
    cosines = (sum(map(operator.mul, axis, direction)) for direction in push.directions)
    return any(abs(cosine) > _SQUEEZES for cosine in cosines)


class GripperDriver:
    """Carries out the commands of one input to a gripper; a command holds until the next one.

    port: name of the input, for messages. commander: of the fingers. complaints: what a command
    asks for in vain.
    """

    def __init__(
        self, port: str, gripper: Gripper, commander: Commander, complaints: Complaints
    ) -> None:
        self._port = port
        self._gripper = gripper
        self._commander = commander
        self._complaints = complaints
        self._command: GripperCommand | None = None

    def apply(self, command: GripperCommand) -> None:
        """Carry out a command from now on.

        Raises CommandError for a value that is no finite number, and a force below 0.
        """
        for field, value in (("width", command.width), ("force", command.force)):
            if not math.isfinite(value):
                raise CommandError(f"input {self._port!r}: {field} is {value}, not a finite number")
        if command.force < 0.0:
            raise CommandError(
                f"input {self._port!r}: force {command.force:g} N is negative; the width says "
                "whether to open or to close"
            )
        self._complain(command)
        self._command = command

    def _complain(self, command: GripperCommand) -> None:
        subject = f"input {self._port!r}"
        least, most = self._gripper.widths
        if not least <= command.width <= most:
            text = f"width {command.width:g} m is out of reach ({least:g} to {most:g} m)"
            self._complaints.add(subject, "width", text)
        if command.force > self._gripper.max_force:
            limit = self._gripper.max_force
            text = f"force {command.force:g} N is beyond its limit of {limit:g}; cut there"
            self._complaints.add(subject, "force", text)

    def before_step(self) -> None:
        """Move both fingers towards the width, no harder than the command allows."""
        if self._command is None:
            return
        gap = self._command.width - self._gripper.width()
        speed = self._gripper.speed
        velocity = min(max(_GAIN * gap / 2, -speed), speed)
        force = self._command.force
        self._commander.apply(
            JointCommand(mode="velocity", values=[velocity] * 2, effort_limit=[force] * 2)
        )
