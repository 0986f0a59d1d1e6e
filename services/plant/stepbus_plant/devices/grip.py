"""What a gripper holds: how far it has slid, and how it follows the arc of the pads."""

import math
import operator
from collections.abc import Sequence

import pybullet as bullet

from .poses import LinkIndex

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
