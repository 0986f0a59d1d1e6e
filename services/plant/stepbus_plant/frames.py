"""Frames of links, and how they move."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from stepbus_plant.devices.sensor_errors import Errors
from stepbus_plant.poses import LinkIndex
from stepbus_plant.world_sensors import WORLD, TransformSettings
from stepbus_schemas import Description, Transforms

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
    rotation: Array = np.reshape(bullet.getMatrixFromQuaternion(quaternion), (3, 3))
    return rotation


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


class TransformSensor:
    """Measures where links are in the frame of another link, or of the world.

    links: their names and indices; parent: that of the reference, None: the world.
    """

    def __init__(
        self,
        name: str,
        row: TransformSettings,
        links: Sequence[tuple[str, LinkIndex]],
        parent: LinkIndex | None,
        client: int,
        *,
        seed: int,
    ) -> None:
        self._row = row
        self._links = links
        self._parent = parent
        self._client = client

        def errors(quantity: str) -> Errors:
            noise, bias = getattr(row.noise, quantity), getattr(row.bias, quantity)
            return Errors(seed, f"transforms/{name}/{quantity}", noise, bias, 3 * len(links))

        self._position, self._orientation = errors("position"), errors("orientation")

    def describe(self) -> Description:
        """Return the links."""
        return Description(names=[name for name, _ in self._links])

    def sense(self, _t_ns: int) -> Transforms:
        """Return the current transforms."""
        inverse = None
        if self._parent is not None:
            frame = read_frame(self._client, self._parent)
            inverse = bullet.invertTransform(frame.position.tolist(), frame.orientation)
        poses = []
        for _, link in self._links:
            frame = read_frame(self._client, link)
            pose = frame.position.tolist(), frame.orientation
            poses.append(pose if inverse is None else bullet.multiplyTransforms(*inverse, *pose))
        count = len(poses)
        true = np.array([position for position, _ in poses]).reshape(-1)
        positions = self._position.disturb(true).reshape(count, 3)
        angles = self._orientation.disturb(np.zeros(3 * count)).reshape(count, 3)
        return Transforms(
            parents=[self._row.parent or WORLD] * count,
            children=[name for name, _ in self._links],
            position=[point(row) for row in positions],
            orientation=[
                tilted(orientation, turn) if turn.any() else tuple(orientation)
                for (_, orientation), turn in zip(poses, angles, strict=True)
            ],
        )
