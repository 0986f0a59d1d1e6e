"""Transforms of links in the frame of another one."""

from collections.abc import Sequence

import numpy as np
import pybullet as bullet

from stepbus_plant.devices.poses import LinkIndex
from stepbus_plant.world.sensors import WORLD, TransformSettings
from stepbus_schemas import Description, Transforms

from .errors import Errors
from .frames import point, read_frame, tilted


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
