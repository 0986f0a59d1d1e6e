"""A planar lidar on a link."""

import math

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from stepbus_plant.devices.poses import LinkIndex
from stepbus_plant.world.sensors import LidarSettings
from stepbus_schemas import Description, LaserScan

from .errors import Errors
from .frames import read_frame


class Lidar:
    """Casts rays in the x-y plane of a link, counter-clockwise from `angle_min` about z.

    A ray begins at `range_min`, so that it does not see the sensor's own housing.
    """

    def __init__(
        self, name: str, row: LidarSettings, link: LinkIndex, client: int, seed: int
    ) -> None:
        self._row = row
        self._link = link
        self._client = client
        steps = max(row.rays - 1, 1)
        self._increment = (row.angle_max - row.angle_min) / steps
        angles = row.angle_min + self._increment * np.arange(row.rays)
        self._directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(row.rays)], axis=1)
        # The rays of a unit have one offset, and noise of their own.
        self._offset = Errors(seed, f"lidars/{name}/bias", 0.0, row.bias, 1)
        self._noise = Errors(seed, f"lidars/{name}/ranges", row.noise, 0.0, row.rays)
        # Before the first step, the engine's bounding boxes are those of loading.
        bullet.performCollisionDetection(client)

    def describe(self) -> Description:
        """Return the link, and the number of rays."""
        return Description(names=[self._row.link], shape=[self._row.rays])

    def sense(self, _t_ns: int) -> LaserScan:
        """Return a scan of the world as it is now."""
        row = self._row
        return LaserScan(
            angle_min=row.angle_min,
            angle_increment=self._increment,
            range_min=row.range_min,
            range_max=row.range_max,
            ranges=[float(value) for value in self._ranges()],
        )

    def _ranges(self) -> NDArray[np.float64]:
        row = self._row
        frame = read_frame(self._client, self._link)
        directions = self._directions @ frame.rotation.T
        starts = frame.position + row.range_min * directions
        ends = frame.position + row.range_max * directions
        hits = bullet.rayTestBatch(
            starts.tolist(), ends.tolist(), numThreads=1, physicsClientId=self._client
        )
        found = np.array([hit[2] if hit[0] >= 0 else math.inf for hit in hits])
        ranges = row.range_min + found * (row.range_max - row.range_min)
        seen = np.isfinite(ranges)
        disturbed = self._noise.disturb(self._offset.disturb(np.zeros(1))[0] + ranges)
        disturbed[seen & (disturbed > row.range_max)] = math.inf
        disturbed[seen & (disturbed < row.range_min)] = -math.inf
        result: NDArray[np.float64] = np.where(seen, disturbed, math.inf)
        return result
