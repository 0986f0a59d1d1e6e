"""Inertial unit, force-torque sensor, lidar, point cloud and transforms of a world."""

import math

import numpy as np
import pytest
from support.services.camera import make_plant, write_scene
from support.services.control import STEP_NS
from support.services.devices import box, joint, link, write_urdf

from stepbus_participant import SettingsError
from stepbus_schemas import WiringError

STEP = STEP_NS * 1e-9
ARM = """
bodies:
  arm: {urdf: arm.urdf, fixed_base: true, position: [0, 0, 1], joints: {hinge: {velocity: 2.0}}}
  wall: {urdf: wall.urdf, fixed_base: true, position: [2.05, 0, 1]}
"""


def scene(folder, sensors, gravity="[0, 0, -10]"):
    """Write an arm of 2 kg that turns about z at 2 rad/s, 1.95 m before a wall, with sensors."""
    write_urdf(
        folder,
        "arm",
        link("post", 1.0, box("0.01 0.01 0.01")),
        link("bar", 2.0, box("0.02 0.02 0.02")).replace('xyz="0 0 0"', 'xyz="0.3 0 0.1"', 1),
        '<link name="tip"/>',
        joint("hinge", "continuous", "post", "bar", "0 0 0", "0 0 1", "10 20"),
        joint("mount", "fixed", "bar", "tip", "0.5 0 0", "0 0 1", "0 0"),
    )
    write_urdf(folder, "wall", link("wall", 1.0, box("0.2 4 4")))
    (folder / "world.yaml").write_text(f"gravity: {gravity}\n{sensors}\n{ARM}")


def readings(folder, port, port_type, steps=1, seed=0):
    """Return what the plant publishes on one port in some steps; None where it has no message."""
    plant = make_plant(folder, {port: port_type}, seed=seed)
    found = []
    for _ in range(steps):
        found.append(plant.output(None).get(port))
        plant.plant.advance()
    return found


def test_an_imu_measures_spin_gravity_and_the_pull_to_the_axis_in_its_link(tmp_path):
    scene(tmp_path, "imus: {imu: {link: tip}}")
    found = readings(tmp_path, "imu", "Imu/1", steps=20)
    np.testing.assert_allclose(found[-1].angular_velocity, [0, 0, 2], atol=1e-6)
    # The mean over a step lags by half of it: the pull turns by 2 rad/s · step / 2.
    lag = 2 * STEP / 2
    expected = [-0.5 * 4 * math.cos(lag), 0.5 * 4 * math.sin(lag), 10]
    np.testing.assert_allclose(found[-1].linear_acceleration, expected, atol=2e-3)
    assert found[0].linear_acceleration == pytest.approx([0, 0, 10])


def test_an_imu_measures_its_orientation_unless_it_does_not(tmp_path):
    scene(tmp_path, "imus: {a: {link: tip}, b: {link: tip, orientation: false}}")
    x, y, z, w = readings(tmp_path, "a", "Imu/1", steps=51)[-1].orientation
    assert (x, y) == pytest.approx((0, 0), abs=1e-9)
    assert 2 * math.atan2(z, w) == pytest.approx(2 * 50 * STEP, abs=1e-4)
    assert readings(tmp_path, "b", "Imu/1")[0].orientation is None


def test_a_falling_imu_feels_nothing(tmp_path):
    scene(tmp_path, "imus: {imu: {link: wall}}")
    world = (tmp_path / "world.yaml").read_text()
    falling = world.replace("wall.urdf, fixed_base: true", "wall.urdf")
    (tmp_path / "world.yaml").write_text(falling)
    found = readings(tmp_path, "imu", "Imu/1", steps=10)[-1]
    np.testing.assert_allclose(found.linear_acceleration, 0, atol=1e-6)


def test_transforms_are_poses_in_the_frame_of_the_parent(tmp_path):
    scene(tmp_path, "transforms: {tf: {links: [tip, post], parent: bar}}")
    found = readings(tmp_path, "tf", "Transforms/1", steps=9)[-1]
    assert (found.parents, found.children) == (["bar", "bar"], ["tip", "post"])
    np.testing.assert_allclose(found.position, [[0.5, 0, 0], [0, 0, 0]], atol=1e-6)
    assert found.orientation[0] == pytest.approx((0, 0, 0, 1), abs=1e-6)
    _, _, z, w = found.orientation[1]
    assert 2 * math.atan2(z, w) == pytest.approx(-2 * 8 * STEP, abs=1e-4)


def test_a_point_cloud_lies_on_what_the_camera_sees_and_has_its_colours(tmp_path):
    write_scene(tmp_path)
    plant = make_plant(tmp_path, {"points": "PointCloud/1", "depth": "Image/1"})
    shown = plant.output(None)
    cloud = shown["points"]
    points = np.frombuffer(cloud.points, "<f4").reshape(cloud.count, 3)
    colours = np.frombuffer(cloud.colours, np.uint8).reshape(cloud.count, 3)
    orange = colours[:, 2] == 0
    assert cloud.count == np.isfinite(np.frombuffer(shown["depth"].data, "<f4")).sum()
    assert orange.sum() > 1000
    np.testing.assert_allclose(points[orange, 2], 0.9, atol=1e-4)
    assert points[orange, :2].min(axis=0) == pytest.approx([0, -0.1], abs=0.005)
    assert points[orange, :2].max(axis=0) == pytest.approx([0.2, 0], abs=0.005)


def test_a_point_cloud_with_stride_has_fewer_points(tmp_path):
    write_scene(tmp_path)
    full = make_plant(tmp_path, {"points": "PointCloud/1"}).output(None)["points"].count
    world = (tmp_path / "world.yaml").read_text()
    (tmp_path / "world.yaml").write_text(world.replace("fov: 1.0", "fov: 1.0, stride: 4"))
    assert make_plant(tmp_path, {"points": "PointCloud/1"}).output(None)[
        "points"
    ].count == pytest.approx(full / 16, rel=0.05)


NOISY = {
    "imu": ("Imu/1", "imus: {imu: {link: post, noise: {angular_velocity: 0.1}}}"),
    "ft": ("Wrench/1", "wrenches: {ft: {joint: mount, noise: {force: 0.1}}}"),
    "front": ("LaserScan/1", "lidars: {front: {link: post, rays: 3, noise: 0.1}}"),
    "tf": ("Transforms/1", "transforms: {tf: {links: [post], noise: {orientation: 0.1}}}"),
}


@pytest.mark.parametrize("port", NOISY)
def test_noise_differs_from_reading_to_reading_and_repeats_with_the_seed(tmp_path, port):
    port_type, sensors = NOISY[port]
    scene(tmp_path, sensors)
    one, same, other = (readings(tmp_path, port, port_type, 3, seed) for seed in (1, 1, 2))
    assert one == same
    assert one[1] != one[2]
    assert one[1] != other[1]


def test_noise_and_bias_have_the_declared_size(tmp_path):
    errors = "noise: {angular_velocity: 0.5}, bias: {linear_acceleration: 3}"
    scene(tmp_path, f"imus: {{imu: {{link: post, {errors}}}}}")
    found = readings(tmp_path, "imu", "Imu/1", steps=400)
    spins = np.array([reading.angular_velocity for reading in found])
    assert spins.std(axis=0) == pytest.approx([0.5] * 3, rel=0.15)
    offsets = np.array([reading.linear_acceleration for reading in found]) - [0, 0, 10]
    assert np.ptp(offsets, axis=0) == pytest.approx([0, 0, 0], abs=1e-9)
    assert 0.3 < np.abs(offsets[0]).max() < 12


def test_depth_noise_is_in_image_and_cloud_alike(tmp_path):
    write_scene(tmp_path)
    ports = {"points": "PointCloud/1", "depth": "Image/1"}
    errors = {"depth_floor": 0.01, "depth_bias": 0.02}
    shown = make_plant(tmp_path, ports, camera=errors).output(None)
    depth = np.frombuffer(shown["depth"].data, "<f4")
    points = np.frombuffer(shown["points"].points, "<f4").reshape(-1, 3)
    np.testing.assert_array_equal(points[:, 2], depth[np.isfinite(depth)])
    top = points[np.abs(points[:, 2] - np.median(points[:, 2])) < 0.05, 2]
    assert 0.008 < top.std() < 0.012


def test_a_sensor_publishes_at_its_period_alone(tmp_path):
    scene(tmp_path, f"imus: {{imu: {{link: post, period: {3 * STEP_NS}ns}}}}")
    found = readings(tmp_path, "imu", "Imu/1", steps=7)
    assert [reading is not None for reading in found] == [True, False, False] * 2 + [True]


def test_a_sensor_changes_no_other_reading(tmp_path):
    scene(tmp_path, "")
    plain = readings(tmp_path, "state", "JointState/1", steps=50)[-1]
    scene(tmp_path, "\n".join(sensors for _, sensors in NOISY.values()))
    ports = {port: port_type for port, (port_type, _) in NOISY.items()}
    plant = make_plant(tmp_path, {**ports, "state": "JointState/1"})
    for _ in range(49):
        plant.output(None)
        plant.plant.advance()
    assert plant.output(None)["state"] == plain


def test_a_port_without_a_sensor_says_what_the_world_lacks(tmp_path):
    scene(tmp_path, "imus: {a: {link: post}, b: {link: bar}}")
    with pytest.raises(WiringError, match="world has no 'lidars'"):
        make_plant(tmp_path, {"scan": "LaserScan/1"})
    with pytest.raises(WiringError, match="world's imus: a, b"):
        make_plant(tmp_path, {"imu": "Imu/1"})


@pytest.mark.parametrize(
    ("sensors", "sentence"),
    [
        ("lidars: {l: {link: post, rays: 0}}", "lidars.l.rays: must be an integer from 1 to"),
        ("lidars: {l: {link: post, range_min: 5, range_max: 4}}", "is not less than 'range_max'"),
        ("imus: {i: {link: post, noise: {spin: 1}}}", "unknown key 'spin'"),
        ("wrenches: {w: {}}", "the key 'joint' is missing"),
    ],
)
def test_a_mistake_in_a_sensor_has_its_sentence(tmp_path, sensors, sentence):
    scene(tmp_path, sensors)
    with pytest.raises(SettingsError, match=sentence):
        make_plant(tmp_path, {})


def test_without_dynamics_sensors_follow_the_motion_and_forces_are_zero(tmp_path):
    scene(tmp_path, "\n".join(sensors for _, sensors in NOISY.values()))
    world = (tmp_path / "world.yaml").read_text()
    (tmp_path / "world.yaml").write_text(
        world.replace("{velocity: 2.0}", "{mode: velocity}").replace("noise: {force: 0.1}", "")
    )
    ports = {port: port_type for port, (port_type, _) in NOISY.items()}
    plant = make_plant(tmp_path, ports, dynamics="off")
    plant.plant.advance()
    shown = plant.output(None)
    assert shown["ft"].force == (0.0, 0.0, 0.0)
    assert shown["imu"].linear_acceleration == pytest.approx([0, 0, 10])
    assert math.isfinite(shown["front"].ranges[1])
