"""The sensors of a world file: every key, declared once.

noise: standard deviation of every reading. bias: standard deviation of an offset that is constant
during a run; the run's seed draws it.
"""

from collections.abc import Iterator
from typing import Annotated

import msgspec

from stepbus_participant import Duration, Finite, Names, NonNegative, Positive, Settings
from stepbus_participant.parameters import Keys

WORLD = "world"
_MOST_RAYS = 10_000


class ImuErrors(Settings):
    """Errors of an inertial unit, of each axis."""

    angular_velocity: NonNegative = 0.0
    """[rad/s]"""
    linear_acceleration: NonNegative = 0.0
    """[m/s²]"""
    orientation: NonNegative = 0.0
    """[rad]"""


class ImuSettings(Settings):
    """An inertial unit."""

    link: str
    """Link that carries it; it measures in the frame of that link."""
    period_ns: Duration | None = None
    """Period of the readings, a multiple of the plant's step. Default: each step."""
    orientation: bool = True
    """Whether it also measures its orientation."""
    noise: ImuErrors = ImuErrors()
    """Standard deviation of Gaussian noise."""
    bias: ImuErrors = ImuErrors()
    """Standard deviation of the constant offset that each run draws."""


class WrenchErrors(Settings):
    """Errors of a force-torque sensor, of each axis."""

    force: NonNegative = 0.0
    """[N]"""
    torque: NonNegative = 0.0
    """[N·m]"""


class WrenchSettings(Settings):
    """A force-torque sensor."""

    joint: str
    """Joint that carries it, of any type, fixed ones included."""
    period_ns: Duration | None = None
    """Period of the readings, a multiple of the plant's step. Default: each step."""
    noise: WrenchErrors = WrenchErrors()
    """Standard deviation of Gaussian noise."""
    bias: WrenchErrors = WrenchErrors()
    """Standard deviation of the constant offset that each run draws."""


class LidarSettings(Settings):
    """A planar lidar."""

    link: str
    """Link that carries it; its rays are in the x-y plane of that link's frame."""
    period_ns: Duration | None = None
    """Period of the scans, a multiple of the plant's step. Default: each step."""
    rays: Annotated[int, msgspec.Meta(ge=1, le=_MOST_RAYS)] = 181
    """Number of rays."""
    angle_min: Finite = -1.5707963267948966
    """Angle of the first ray about z [rad]."""
    angle_max: Finite = 1.5707963267948966
    """Angle of the last ray [rad]."""
    range_min: NonNegative = 0.05
    """Smallest range that it measures [m]."""
    range_max: Positive = 10.0
    """Largest range that it measures [m]."""
    noise: NonNegative = 0.0
    """Standard deviation of Gaussian noise of each range [m]."""
    bias: NonNegative = 0.0
    """Standard deviation of the constant offset of all ranges that each run draws [m]."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what no lidar can have."""
        if self.angle_min > self.angle_max:
            yield ("angle_min",), f"{self.angle_min:g} rad is above 'angle_max', {self.angle_max:g}"
        if self.range_min >= self.range_max:
            yield ("range_min",), f"{self.range_min:g} m is not less than 'range_max'"


class TransformErrors(Settings):
    """Errors of transforms, of each axis."""

    position: NonNegative = 0.0
    """[m]"""
    orientation: NonNegative = 0.0
    """[rad]"""


class TransformSettings(Settings):
    """Transforms of links."""

    links: Names
    """Links whose frames it measures, named as in `poses`."""
    parent: str = WORLD
    """Frame in which it measures them: `world` or a link."""
    period_ns: Duration | None = None
    """Period of the readings, a multiple of the plant's step. Default: each step."""
    noise: TransformErrors = TransformErrors()
    """Standard deviation of Gaussian noise."""
    bias: TransformErrors = TransformErrors()
    """Standard deviation of the constant offset that each run draws."""
