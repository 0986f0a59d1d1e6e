"""What sensors of the plant disturb: odometry that slips, a lens, and random numbers by counter."""

import math
import zlib

import numpy as np
import pytest

from stepbus_plant.base import Base
from stepbus_plant.camera import Lens
from stepbus_plant.noise import Noise
from stepbus_plant.params import CameraErrors, OdometryErrors
from stepbus_plant.world import BaseSettings

MS = 1_000_000
GREY = np.full((40, 60, 3), 128, dtype=np.uint8)
WALL = np.full((40, 60), 0.5, dtype="<f4")


@pytest.mark.parametrize("number", [0, 1, 16_000_000, 2**63])
def test_a_reading_has_the_numbers_of_a_generator_that_begins_at_its_counter(number):
    noise, counter = Noise(-7, "color", "camera"), np.array([0, 0, number, 0], dtype=np.uint64)
    key = np.array([2**64 - 7, zlib.crc32(b"color/camera")], dtype=np.uint64)
    # Leaves half of a number over, which the next reading must not use.
    noise.at(3).standard_normal(5, dtype=np.float32)
    expected = np.random.Generator(np.random.Philox(key=key, counter=counter))
    for _ in range(2):
        assert np.array_equal(noise.at(number).normal(size=9), expected.normal(size=9))
        expected = np.random.Generator(np.random.Philox(key=key, counter=counter))


@pytest.mark.parametrize(
    "noise", [Noise(8, "color", "camera"), Noise(7, "color", "other"), Noise(7, "depth", "camera")]
)
def test_seeds_sensors_and_purposes_have_streams_of_their_own(noise):
    assert noise.at(5).random() != Noise(7, "color", "camera").at(5).random()


class Wheels:
    """Physics of two wheels that turn as a test wants."""

    body, index = 0, 0

    def __init__(self):
        self.angles = [0.0, 0.0]

    def read(self, body, indices):
        return [(angle, 0.0, None, 0.0) for angle in self.angles]


def odometry(seed=0, *, distance=1.0, steps=50, **errors):
    """Return odometry after both wheels have turned by a distance [m]."""
    wheels = Wheels()
    row = BaseSettings(left="l", right="r", wheel_radius=0.1, track=0.5)
    noise = Noise(seed, "odometry", "base")
    base = Base(row, (wheels, wheels), wheels, OdometryErrors(**errors), noise)
    for n in range(1, steps + 1):
        wheels.angles = [distance / 0.1 * n / steps] * 2
        state = base.sense(n)
    return state


@pytest.mark.parametrize("steps", [20, pytest.param(200, marks=pytest.mark.slow)])
def test_slip_grows_with_the_root_of_the_distance_however_many_steps_it_takes(steps):
    def spread(distance):
        runs = [odometry(n, distance=distance, steps=steps, slip=0.01) for n in range(200)]
        return np.std([state.yaw for state in runs])

    # Two wheels, 0.5 m apart.
    assert spread(1.0) == pytest.approx(0.01 * math.sqrt(2) / 0.5, rel=0.15)
    assert spread(4.0) == pytest.approx(2 * 0.01 * math.sqrt(2) / 0.5, rel=0.15)


def test_wheels_of_another_radius_bend_the_path_alike_each_time():
    one, other = (odometry(5, wheel=0.01, distance=d) for d in (1.0, 2.0))
    assert other.yaw == pytest.approx(2 * one.yaw)
    assert one.yaw != 0.0


def test_noise_of_colour_and_depth_is_as_large_as_wanted():
    lens = Lens(CameraErrors(color=4.0, depth=0.004), 0)
    assert np.std(lens.colors(GREY, "camera", 0)) == pytest.approx(4.0, rel=0.05)
    noisy = lens.depth(WALL, "camera", 0)
    assert np.std(noisy) == pytest.approx(0.004 * 0.5**2, rel=0.05)
    coarse = Lens(CameraErrors(depth=0.004, depth_floor=0.01), 0).depth(WALL, "camera", 0)
    assert np.std(coarse) == pytest.approx(0.01 + 0.004 * 0.5**2, rel=0.05)
    assert noisy.dtype == WALL.dtype


def test_all_depths_of_a_run_have_one_offset():
    lens = Lens(CameraErrors(depth_bias=0.02), 3)
    one, later = (lens.depth(WALL, "camera", t) - WALL for t in (0, MS))
    assert np.ptp(one) == 0.0
    assert 0.0 < abs(one[0, 0]) < 0.1
    assert np.array_equal(one, later)
    assert one[0, 0] != lens.depth(WALL, "other", 0)[0, 0] - WALL[0, 0]


def test_each_image_and_each_camera_has_noise_of_its_own():
    lens = Lens(CameraErrors(color=4.0), 0)
    images = [lens.colors(GREY, name, t) for name, t in (("a", 0), ("a", MS), ("b", 0))]
    assert not any(np.array_equal(images[0], other) for other in images[1:])
    assert np.array_equal(images[0], lens.colors(GREY, "a", 0))


def test_where_there_is_nothing_there_is_no_noise():
    nothing = np.full((4, 4), np.inf, dtype="<f4")
    assert np.isinf(Lens(CameraErrors(depth=0.01), 0).depth(nothing, "camera", 0)).all()


def test_blur_widens_an_edge_and_keeps_the_light():
    edge = np.zeros((20, 40, 3), dtype=np.uint8)
    edge[:, 20:] = 200
    blurred = Lens(CameraErrors(blur=1.0), 0).colors(edge, "camera", 0)
    row = blurred[10, :, 0].astype(int)
    assert row[:15].max() == 0
    assert row[25:].min() == 200
    assert 0 < row[19] < 100 < row[20] < 200
    assert (np.diff(row) >= 0).all()


def test_the_lamp_stands_elsewhere_with_another_seed_and_makes_shadows():
    lamps = [Lens(CameraErrors(light="lamp"), seed).light for seed in (0, 0, 1)]
    assert lamps[0] == lamps[1]
    assert lamps[0].direction != lamps[2].direction
    assert lamps[0].has_shadow
    assert not Lens(CameraErrors(), 0).light.has_shadow
