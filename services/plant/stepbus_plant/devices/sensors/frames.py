"""Frames of links, and how they move."""

from typing import Any, NamedTuple

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from stepbus_plant.devices.poses import LinkIndex

Array = NDArray[np.float64]
_ROOT = -1


class Frame(NamedTuple):
    """A link's frame in the world.

    position: shape (3,), [m]. rotation: from the link to the world, shape (3, 3). velocity:
    of its origin, shape (3,), [m/s]. spin: angular velocity in the world, shape (3,), [rad/s].
    orientation: quaternion x, y, z, w.
    """

    position: Array
    rotation: Array
    velocity: Array
    spin: Array
    orientation: tuple[float, float, float, float]


def read_frame(client: int, link: LinkIndex) -> Frame:
    """Return the frame of a link; PyBullet gives the velocity of its centre of mass."""
    body, index = link
    if index == _ROOT:
        centre = bullet.getBasePositionAndOrientation(body, client)
        inertial = bullet.getDynamicsInfo(body, _ROOT, client)[3:5]
        pose = bullet.multiplyTransforms(*centre, *bullet.invertTransform(*inertial))
        velocity, spin = bullet.getBaseVelocity(body, client)
    else:
        state = bullet.getLinkState(
            body,
            index,
            computeLinkVelocity=True,
            computeForwardKinematics=True,
            physicsClientId=client,
        )
        centre, pose, velocity, spin = state[0:2], state[4:6], state[6], state[7]
    position, turn = np.array(pose[0]), np.array(spin)
    return Frame(
        position=position,
        rotation=rotation_of(pose[1]),
        velocity=np.array(velocity) + np.cross(turn, position - np.array(centre[0])),
        spin=turn,
        orientation=pose[1],
    )


def rotation_of(quaternion: Any) -> Array:
    """Return the matrix of a quaternion x, y, z, w, shape (3, 3)."""
    found: Array = np.reshape(bullet.getMatrixFromQuaternion(quaternion), (3, 3))
    return found


def point(values: Array) -> tuple[float, float, float]:
    """Return three numbers as a message has them."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def tilted(quaternion: Any, angles: Array) -> tuple[float, float, float, float]:
    """Return an orientation turned by small angles about its own axes [rad]."""
    half = angles / 2
    turn = np.array([*half, 1.0])
    turn = turn / np.linalg.norm(turn)
    return bullet.multiplyTransforms((0, 0, 0), quaternion, (0, 0, 0), turn.tolist())[1]  # type: ignore[no-any-return]  # PyBullet has no types
