"""What a gripper holds: how far it has slid, and how it follows the arc of the pads."""

import math
import operator
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pybullet as bullet

from stepbus_plant.commander import Commander
from stepbus_plant.engine import Physics
from stepbus_plant.errors import CommandError
from stepbus_plant.joint import Joint, describe_joints
from stepbus_plant.poses import LinkIndex
from stepbus_plant.sensing import Warnings
from stepbus_plant.world import GripperSettings
from stepbus_schemas import Description, GripperCommand, GripperState, JointCommand

_NO_TURN = (0.0, 0.0, 0.0, 1.0)

Point = Sequence[float]


class Grip:
    """A grip, from its first contact on.

    finger: the left one. slide: its axis, in its frame. thing: what is held. points: of contact
    with both pads, in the world [m].
    """

    def __init__(
        self,
        client: int,
        finger: LinkIndex,
        slide: Point,
        thing: LinkIndex,
        points: Sequence[Point],
    ) -> None:
        self.thing = thing
        self._client, self._finger, self._slide = client, finger, slide
        middle = [sum(axis) / len(points) for axis in zip(*points, strict=True)]
        self._on_thing = _into(frame_of(client, thing), middle)
        self._on_finger = _into(frame_of(client, finger), middle)
        mass = bullet.getDynamicsInfo(*thing, physicsClientId=client)[0]
        self._is_free = thing[1] < 0 and mass > 0.0
        self._before: Point = ()

    def _where(self) -> Point:
        """Return where the point of the thing is that was first gripped [m]."""
        return _out_of(frame_of(self._client, self.thing), self._on_thing)

    def slip(self) -> float:
        """Return how far it has slid along the pads [m]."""
        now = _into(frame_of(self._client, self._finger), self._where())
        moved = [a - b for a, b in zip(now, self._on_finger, strict=True)]
        across = sum(map(operator.mul, moved, self._slide))
        return math.sqrt(max(sum(part * part for part in moved) - across * across, 0.0))

    def before_substep(self) -> None:
        """Keep where it is gripped."""
        self._before = self._where()
        self._at = _into(frame_of(self._client, self._finger), self._before)

    def after_substep(self, dt: float) -> None:
        """Move the thing from the tangent, along which the engine moves it, to the pads' arc.

        On a circle it would go outwards by ω² r dt / 2 per second: by 2 mm in a swing of the arm at
        a physics step dt of 4 ms [s], however strong the friction. Half of the pads' acceleration
        that no joint's acceleration explains is the difference between their displacement and their
        velocity at its end. Friction is not touched: what it does not hold slides.
        """
        if not self._is_free or not self._before:
            return
        client = self._client
        state = bullet.getLinkState(
            *self._finger,
            computeLinkVelocity=True,
            computeForwardKinematics=True,
            physicsClientId=client,
        )
        after = _out_of((state[4], state[5]), self._at)
        arm = [a - b for a, b in zip(after, state[0], strict=True)]
        velocity = [a + b for a, b in zip(state[6], _cross(state[7], arm), strict=True)]
        pose = bullet.getBasePositionAndOrientation(self.thing[0], client)
        moving = bullet.getBaseVelocity(self.thing[0], client)
        rows = zip(pose[0], after, self._before, velocity, strict=True)
        position = [p - ((new - old) - v * dt) for p, new, old, v in rows]
        bullet.resetBasePositionAndOrientation(self.thing[0], position, pose[1], client)
        bullet.resetBaseVelocity(self.thing[0], *moving, physicsClientId=client)


def frame_of(client: int, link: LinkIndex) -> tuple[Point, Point]:
    """Return the pose of a link in the world; of the base of a body, that of its centre of mass."""
    body, number = link
    if number < 0:
        position, rotation = bullet.getBasePositionAndOrientation(body, client)
        return position, rotation
    state = bullet.getLinkState(body, number, computeForwardKinematics=True, physicsClientId=client)
    return state[4], state[5]


def _into(frame: tuple[Point, Point], point: Point) -> Point:
    """Return a point of the world in a frame."""
    return _out_of(bullet.invertTransform(*frame), point)


def _out_of(frame: tuple[Point, Point], point: Point) -> Point:
    """Return a point of a frame in the world."""
    moved: Point = bullet.multiplyTransforms(*frame, point, _NO_TURN)[0]
    return moved


def _cross(a: Point, b: Point) -> Point:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


# Proportional gain from the width error to the finger velocity [1/s].
_GAIN = 10.0

# Least cosine between a contact normal and the opening direction of the fingers: 45°.
_LEAST_COSINE = math.sqrt(0.5)

# Least cosine between the normals of what presses and the opening direction: 25°. Beyond it,
# contacts are renewed. What presses is then found without knowing how hard, and slides by about
# 0.2 mm, so that this is not done again until the gripper has turned by 10°.
_FRESH_COSINE = math.cos(math.radians(25.0))
_TURNED_COSINE = math.cos(math.radians(10.0))

# What the engine gives a moving link: collision group, and groups that it collides with.
_GROUP, _ALL_GROUPS = 1, -1

FORCE_WITHOUT_DYNAMICS = 15.0
"""Reported of a gripper that holds something while dynamics are off [N]."""


@dataclass(frozen=True)
class _Contact:
    """The contact of a finger with an object: force [N], normals of its points, ±, and points."""

    force: float
    normals: list[Sequence[float]]
    points: list[Sequence[float]]


class Gripper:
    """Two coupled prismatic fingers that open towards positive positions.

    width: sum of both positions [m]. held_without_forces: what it holds while dynamics are off.
    """

    def __init__(self, row: GripperSettings, left: Joint, right: Joint, physics: Physics) -> None:
        self.joints = (left, right)
        self.speed = row.speed
        self.max_force = min(left.effort, right.effort)
        self.widths = (left.lower + right.lower, left.upper + right.upper)
        self.fingers = [left.index, right.index]
        self.held_without_forces: LinkIndex | None = None
        self._body = left.body
        self._physics = physics
        self._slide = bullet.getJointInfo(left.body, left.index, physics.client)[13]
        self._grip: Grip | None = None
        self._pressed_along: Sequence[float] = ()
        self._stale: list[int] = []
        self._renewed = False
        self._force = 0.0
        self._couple()

    def _couple(self) -> None:
        """Let the engine keep both positions equal; uncoupled fingers drift with the object."""
        client = self._physics.client
        left, right = self.fingers
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
        """Return the current distance of the fingers [m]."""
        left, right = self._physics.read(self._body, self.fingers)
        width: float = left[0] + right[0]
        return width

    def describe(self) -> Description:
        """Return names and limits of the fingers."""
        return describe_joints(self.joints)

    def before_substep(self) -> None:
        """Prepare a substep; call it before the engine's."""
        if self._stale:
            self._renew_contacts()
        if self._grip is not None:
            self._grip.before_substep()

    def _renew_contacts(self) -> None:
        """Let the engine forget the contacts of fingers, and find them in the next substep.

        Where pads and object turn together, it may keep the normals that points had when they were
        made, and press along them.
        """
        for finger in self._stale:
            bullet.setCollisionFilterGroupMask(
                self._body, finger, _GROUP, _ALL_GROUPS, physicsClientId=self._physics.client
            )
        self._stale, self._renewed = [], True

    def after_substep(self, dt: float) -> None:
        """Let what is held follow the arc of the pads; dt: length of the substep [s]."""
        if self._grip is not None:
            self._grip.after_substep(dt)

    def update(self) -> None:
        """Find out what is held; call it after every communication step.

        The force is that of the weaker finger: the difference between the two does not squeeze the
        object, it pushes it aside until it is centred. Renewed contacts need a moment.
        """
        left, right = (self._contacts(finger) for finger in self.fingers)
        self._force = min(sum(contact.force for contact in side.values()) for side in (left, right))
        both = [(thing, contact, right[thing]) for thing, contact in left.items() if thing in right]
        axis = self.opening() if both else ()
        held = {
            thing: [*one.points, *other.points]
            for thing, one, other in both
            if _is_along(axis, one) and _is_along(axis, other)
        }
        renewed, self._renewed = self._renewed, False
        if renewed and not held:
            return
        if self._grip is None or self._grip.thing not in held:
            pads = (self._body, self.fingers[0])
            grips = (
                Grip(self._physics.client, pads, self._slide, thing, points)
                for thing, points in held.items()
            )
            self._grip = next(grips, None)
            self._pressed_along = axis
        elif _cosine(axis, self._pressed_along) < _TURNED_COSINE:
            sides = zip(self.fingers, (left, right), strict=True)
            self._stale = [finger for finger, side in sides if _is_stale(axis, side.values())]
            self._pressed_along = axis

    def sense(self) -> GripperState:
        """Return the current width and force, whether the gripper holds an object, and its slip."""
        if self.held_without_forces is not None:
            return GripperState(width=self.width(), force=FORCE_WITHOUT_DYNAMICS, holding=True)
        grip = self._grip
        return GripperState(
            width=self.width(),
            force=self._force,
            holding=grip is not None,
            slip=0.0 if grip is None else grip.slip(),
        )

    def opening(self) -> Sequence[float]:
        """Return the opening direction of the fingers in the world frame."""
        _, rotation = frame_of(self._physics.client, (self._body, self.fingers[0]))
        axis: Sequence[float] = bullet.rotateVector(rotation, self._slide)
        return axis

    def _contacts(self, finger: int) -> dict[LinkIndex, _Contact]:
        """Return what a finger presses on, except its own body."""
        points = bullet.getContactPoints(
            bodyA=self._body, linkIndexA=finger, physicsClientId=self._physics.client
        )
        groups: dict[LinkIndex, list[Sequence[Any]]] = {}
        for point in points:
            if point[9] > 0.0 and point[2] != self._body:
                groups.setdefault((point[2], point[4]), []).append(point)
        return {thing: _sum(group) for thing, group in groups.items()}


def _sum(points: Sequence[Sequence[Any]]) -> _Contact:
    force = sum(point[9] for point in points)
    return _Contact(force, [point[7] for point in points], [point[5] for point in points])


def _is_along(axis: Sequence[float], contact: _Contact) -> bool:
    """Return whether a finger squeezes the object instead of resting on it.

    One point is enough: others may be at its rim. The sign of a normal is arbitrary.
    """
    return any(abs(_cosine(axis, normal)) > _LEAST_COSINE for normal in contact.normals)


def _is_stale(axis: Sequence[float], contacts: Iterable[_Contact]) -> bool:
    """Return whether a finger presses on something in a direction that is not its own."""
    normals = (normal for contact in contacts for normal in contact.normals)
    return any(abs(_cosine(axis, normal)) < _FRESH_COSINE for normal in normals)


def _cosine(one: Sequence[float], other: Sequence[float]) -> float:
    return sum(map(operator.mul, one, other), 0.0)


class GripperDriver:
    """Executes the commands of one input to a gripper; a command holds until the next one.

    port: name of the input, for messages. commander: of the fingers. warnings: about commands.
    """

    def __init__(
        self, port: str, gripper: Gripper, commander: Commander, warnings: Warnings
    ) -> None:
        self._port = port
        self._gripper = gripper
        self._commander = commander
        self._warnings = warnings
        self._command: GripperCommand | None = None

    def apply(self, command: GripperCommand) -> None:
        """Execute a command from now on.

        Raises CommandError for a value that is not finite, and for a force below 0.
        """
        for field, value in (("width", command.width), ("force", command.force)):
            if not math.isfinite(value):
                raise CommandError(self._port, f"{field} is {value}, not a finite number")
        if command.force < 0.0:
            raise CommandError(
                self._port,
                f"force {command.force:g} N is negative; the width decides "
                "whether to open or to close",
            )
        self._check_range(command)
        self._command = command

    def _check_range(self, command: GripperCommand) -> None:
        """Warn about a width or force that the gripper cannot reach."""
        subject = f"input {self._port!r}"
        least, most = self._gripper.widths
        if not least <= command.width <= most:
            text = f"width {command.width:g} m is out of reach ({least:g} to {most:g} m)"
            self._warnings.add(subject, "width", text)
        if command.force > self._gripper.max_force:
            limit = self._gripper.max_force
            text = f"force {command.force:g} N exceeds its limit of {limit:g}; limited to it"
            self._warnings.add(subject, "force", text)

    def before_step(self) -> None:
        """Move both fingers towards the width, with no more than the commanded force."""
        if self._command is None:
            return
        gap = self._command.width - self._gripper.width()
        speed = self._gripper.speed
        velocity = min(max(_GAIN * gap / 2, -speed), speed)
        force = self._command.force
        self._commander.apply(
            JointCommand(mode="velocity", values=[velocity] * 2, effort_limit=[force] * 2)
        )
