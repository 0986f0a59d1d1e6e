"""A gripper of two fingers: what it holds, how that follows the pads, and its commands."""

import math
import operator
from collections.abc import Iterable, Sequence

import msgspec

from stepbus_plant.engine import BASE, Contact, Engine, Link
from stepbus_plant.geometry import Pose
from stepbus_plant.joint import Joint, describe_joints
from stepbus_plant.memory import Remembers
from stepbus_plant.world import GripperSettings
from stepbus_schemas import GripperState, Point

# Least cosine between a contact normal and the opening direction of the fingers: 45°.
_LEAST_COSINE = math.sqrt(0.5)

# Least cosine between the normals of what presses and the opening direction: 25°. Beyond it,
# contacts are renewed. What presses is then found without knowing how hard, and slides by about
# 0.2 mm, so that this is not done again until the gripper has turned by 10°.
_FRESH_COSINE = math.cos(math.radians(25.0))
_TURNED_COSINE = math.cos(math.radians(10.0))

FORCE_WITHOUT_DYNAMICS = 15.0
"""Force of each pad on what a gripper holds while dynamics are off [N]."""


class Grip(msgspec.Struct):
    """A grip, from its first contact on.

    thing: what is held. on_thing, on_finger: the middle of the first points of contact, in the
    frames of the thing and of the left finger [m].
    """

    thing: Link
    on_thing: Point
    on_finger: Point


class Gripper(Remembers):
    """Two coupled prismatic fingers that open towards positive positions.

    width: sum of both positions [m]. held_without_forces: what it holds while dynamics are off.
    """

    remembers = ("_grip", "_pressed_along", "_stale", "_renewed", "_force")
    _grip: Grip | None
    _pressed_along: Point
    _stale: list[Link]

    def __init__(self, row: GripperSettings, fingers: tuple[Joint, Joint], engine: Engine) -> None:
        self.joints = fingers
        self.description = describe_joints(fingers)
        self.speed = row.speed
        self.fingers: list[Link] = [(joint.body, joint.index) for joint in self.joints]
        self.held_without_forces: Link | None = None
        self._engine = engine
        self._slide = fingers[0].axis
        self._grip = None
        self._before: Point | None = None
        self._pressed_along = (0.0, 0.0, 0.0)
        self._stale = []
        self._renewed = False
        self._force = 0.0

    def width(self) -> float:
        """Return the current distance of the fingers [m]."""
        body, indices = self.joints[0].body, [joint.index for joint in self.joints]
        left, right = self._engine.read(body, indices)
        width: float = left[0] + right[0]
        return width

    def before_substep(self) -> None:
        """Prepare a substep; call it before the engine's."""
        # Where pads and object turn together, the engine may keep the normals that points had when
        # they were made, and press along them.
        for finger in self._stale:
            self._engine.forget_contacts(finger)
            self._renewed = True
        self._stale = []
        self._before = None
        if (grip := self._grip) is not None and self._is_free(grip.thing):
            self._before = self._where(grip)
            self._at = self._engine.geometry.into(self._pose(self.fingers[0]), self._before)

    def after_substep(self, dt: float) -> None:
        """Move what is held from the tangent, along which the engine moves it, to the pads' arc.

        On a circle it would go outwards by ω² r dt / 2 per second: by 2 mm in a swing of the arm at
        a physics step dt of 4 ms [s], however strong the friction. Half of the pads' acceleration
        that no joint's acceleration explains is the difference between their displacement and their
        velocity at its end. Friction is not touched: what it does not hold slides.
        """
        if self._grip is None or self._before is None:
            return
        body = self._grip.thing[0]
        pads = self._engine.motion(self.fingers[0])
        after = self._engine.geometry.out_of(pads.frame, self._at)
        arm = [a - b for a, b in zip(after, pads.centre, strict=True)]
        velocity = [a + b for a, b in zip(pads.velocity, _cross(pads.spin, arm), strict=True)]
        at, orientation = self._engine.centre(body)
        rows = zip(at, after, self._before, velocity, strict=True)
        x, y, z = (p - ((new - old) - v * dt) for p, new, old, v in rows)
        self._engine.put_centre(body, ((x, y, z), orientation), keeps_velocity=True)

    def update(self) -> None:
        """Find out what is held; call it after every communication step.

        The force is that of the weaker finger: the difference between the two does not squeeze the
        object, it pushes it aside until it is centred. Renewed contacts need a moment.
        """
        sides = [self._pressing(finger) for finger in self.fingers]
        # By thing first: the rounding of a sum depends on its order.
        self._force = min(
            sum(sum(contact.force for contact in contacts) for contacts in side.values())
            for side in sides
        )
        left, right = sides
        both = [thing for thing in left if thing in right]
        axis = self.opening() if both else (0.0, 0.0, 0.0)
        held = [t for t in both if _is_along(axis, left[t]) and _is_along(axis, right[t])]
        renewed, self._renewed = self._renewed, False
        if renewed and not held:
            return
        if self._grip is None or self._grip.thing not in held:
            self._grip = None
            if held:
                points = [contact.on_one for side in sides for contact in side[held[0]]]
                self._grip = self._gripped(held[0], points)
            self._pressed_along = axis
        elif _dot(axis, self._pressed_along) < _TURNED_COSINE:
            self._stale = [
                finger
                for finger, side in zip(self.fingers, sides, strict=True)
                if any(_is_stale(axis, contacts) for contacts in side.values())
            ]
            self._pressed_along = axis

    def sense(self, _t_ns: int) -> GripperState:
        """Return the current width and force, whether the gripper holds an object, and its slip."""
        if self.held_without_forces is not None:
            return GripperState(width=self.width(), force=FORCE_WITHOUT_DYNAMICS, holding=True)
        grip = self._grip
        return GripperState(
            width=self.width(),
            force=self._force,
            holding=grip is not None,
            slip=0.0 if grip is None else self._slip(grip),
        )

    def opening(self) -> Point:
        """Return the opening direction of the fingers in the world frame."""
        return self._engine.geometry.turned(self._engine.frame(self.fingers[0])[1], self._slide)

    def _gripped(self, thing: Link, points: Sequence[Point]) -> Grip:
        """Return the grip of a thing; points: of contact with both pads, in the world [m]."""
        x, y, z = (sum(axis) / len(points) for axis in zip(*points, strict=True))
        on_thing, on_finger = (
            self._engine.geometry.into(self._pose(link), (x, y, z))
            for link in (thing, self.fingers[0])
        )
        return Grip(thing, on_thing, on_finger)

    def _is_free(self, thing: Link) -> bool:
        return thing[1] == BASE and self._engine.mass(thing) > 0.0

    def _pose(self, link: Link) -> Pose:
        """Return the pose of a link; of the root of a body, that of its centre of mass."""
        return self._engine.centre(link[0]) if link[1] == BASE else self._engine.frame(link)

    def _where(self, grip: Grip) -> Point:
        """Return where the point of the thing is that was first gripped [m]."""
        return self._engine.geometry.out_of(self._pose(grip.thing), grip.on_thing)

    def _slip(self, grip: Grip) -> float:
        """Return how far what is held has slid along the pads [m]."""
        now = self._engine.geometry.into(self._pose(self.fingers[0]), self._where(grip))
        moved = [a - b for a, b in zip(now, grip.on_finger, strict=True)]
        across = _dot(moved, self._slide)
        return math.sqrt(max(sum(part * part for part in moved) - across * across, 0.0))

    def _pressing(self, finger: Link) -> dict[Link, list[Contact]]:
        """Return what a finger presses on, except its own body."""
        pressing: dict[Link, list[Contact]] = {}
        for contact in self._engine.contacts(*finger):
            if contact.force > 0.0 and contact.other[0] != finger[0]:
                pressing.setdefault(contact.other, []).append(contact)
        return pressing


def _is_along(axis: Point, contacts: Iterable[Contact]) -> bool:
    """Return whether a finger squeezes the object instead of resting on it.

    One point is enough: others may be at its rim. The sign of a normal is arbitrary.
    """
    return any(abs(_dot(axis, contact.normal)) > _LEAST_COSINE for contact in contacts)


def _is_stale(axis: Point, contacts: Iterable[Contact]) -> bool:
    """Return whether a finger presses on something in a direction that is not its own."""
    return any(abs(_dot(axis, contact.normal)) < _FRESH_COSINE for contact in contacts)


def _dot(one: Sequence[float], other: Sequence[float]) -> float:
    return sum(map(operator.mul, one, other), 0.0)


def _cross(a: Sequence[float], b: Sequence[float]) -> Point:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
