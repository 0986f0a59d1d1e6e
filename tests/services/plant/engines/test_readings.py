"""Sensors, calls and states, beside what they must be. Tolerances were written before measuring."""

import math

import numpy as np
import pytest
from support.services.mechanics import (
    FLOOR,
    MS,
    ROOT,
    STEP,
    G,
    Row,
    advance,
    box,
    centre,
    fixed,
    joint,
    link,
    make,
    robot,
    sensed,
)
from support.tools import needs_opengl

from stepbus_plant.engine import BASE
from stepbus_plant.geometry import quaternion, rotation
from stepbus_schemas import WiringError


@pytest.mark.parametrize("kind", ["fixed", "revolute"])
def test_a_force_torque_sensor_bears_the_weight_beyond_it(tmp_path, engine, kind):
    """Its child lies on its side, and has its mass elsewhere."""
    origin = f'xyz="0 0 0.2" rpy="{math.pi / 2} 0 0"'
    limit = 'lower="-1" upper="1" effort="1e3" velocity="10"'
    urdf = robot(
        ROOT,
        link("tool", 2.0, (0.02, 0.03, 0.04), centre="0.3 0 0.1"),
        joint("mount", kind, "tool", "0 1 0", limit, origin=origin),
    )
    held = "joint_defaults: {mode: position}"
    plant = make(tmp_path, engine, {"arm": fixed(urdf, held)}, "wrenches: {ft: {joint: mount}}")
    sensor = sensed(plant, "Wrench/1")
    reading = sensor.sense(advance(plant, 200).t_ns)
    # Down is -y in the frame of the tool.
    weight = np.array((0.0, -2 * G, 0.0))
    np.testing.assert_allclose(reading.force, weight, atol=0.02)
    np.testing.assert_allclose(reading.torque, np.cross((0.3, 0, 0.1), weight), atol=0.02)


def test_an_imu_at_rest_reads_plus_g(tmp_path, engine):
    standing = Row(box("crate", 1.0, 0.1, 0.1, 0.1), "position: [0, 0, 0.05]")
    bodies = {"ground": fixed(FLOOR), "crate": standing}
    plant = make(tmp_path, engine, bodies, "imus: {imu: {link: crate}}", step_ns=10 * MS)
    sensor = sensed(plant, "Imu/1")
    for _ in range(100):
        reading = sensor.sense(advance(plant, 1).t_ns)
    assert reading.linear_acceleration == pytest.approx((0, 0, G), abs=0.02)
    assert reading.angular_velocity == pytest.approx((0, 0, 0), abs=1e-3)


def test_a_lidar_measures_a_wall_exactly(tmp_path, engine):
    bodies = {
        "post": fixed(box("post", 1.0, 0.02, 0.02, 0.02)),
        "wall": fixed(box("wall", 1.0, 0.2, 8, 8), "position: [2.1, 0, 0]"),
    }
    lidar = "lidars: {lidar: {link: post, rays: 9, angle_min: -1, angle_max: 1, range_max: 3}}"
    scan = sensed(make(tmp_path, engine, bodies, lidar), "LaserScan/1").sense(0)
    expected = 2.0 / np.cos(scan.angle_min + scan.angle_increment * np.arange(9))
    np.testing.assert_allclose(scan.ranges, np.where(expected < 3, expected, np.inf), atol=1e-6)


def test_a_body_that_is_moved_is_there_and_at_rest(tmp_path, engine):
    falling = Row(box("crate", 1.0, 0.1, 0.1, 0.1, centre="0.02 0 0.03"), "position: [0, 0, 3]")
    plant = advance(make(tmp_path, engine, {"ground": fixed(FLOOR), "crate": falling}), 300)
    plant.calls.move_body("crate", 1.0, 2.0, 3.0, math.pi / 2)
    (place, turn), *_ = motion = plant.physics.engine.motion((1, BASE))
    assert place == pytest.approx((1, 2, 3), abs=1e-6)
    assert np.abs(turn) == pytest.approx((0, 0, math.sqrt(0.5), math.sqrt(0.5)), abs=1e-6)
    assert (*motion.velocity, *motion.spin) == (0.0,) * 6
    before = centre(plant, "crate")[2]
    n = 100
    advance(plant, n)
    fallen = before - centre(plant, "crate")[2]
    assert fallen == pytest.approx(G * STEP**2 * n * (n + 1) / 2, rel=1e-6)


def test_an_image_has_the_depth_of_what_it_shows(tmp_path, engine):
    needs_opengl(engine)
    """A camera looks along x at a wall 1 m away, whose upper edge is at the height of the camera."""
    looks = '<visual><origin xyz="0 0 0"/><geometry><box size="0.2 4 2"/></geometry>{}</visual>'
    red = '<material name="red"><color rgba="1 0 0 1"/></material>'
    wall = box("wall", 1.0, 0.2, 4, 2).replace("</link>", looks.format(red) + "</link>")
    post = robot(
        link("post", 1.0, (0.1,) * 3),
        '<link name="eye"/>',
        joint(
            "mount",
            "fixed",
            "eye",
            parent="post",
            origin='rpy="-1.5707963267948966 0 -1.5707963267948966"',
        ),
    )
    bodies = {"post": fixed(post), "wall": fixed(wall, "position: [1.1, 0, -1]")}
    camera = "cameras: {eye: {link: eye, width: 64, height: 48, near: 0.1, far: 5}}"
    plant = make(tmp_path, engine, bodies, camera)
    try:
        rgb, depth = plant.devices.cameras["eye"].render()
    except WiringError as exc:
        pytest.skip(str(exc))
    metres = np.frombuffer(depth.data, "<f4").reshape(48, 64)
    colours = np.frombuffer(rgb.data, np.uint8).reshape(48, 64, 3)
    assert np.isinf(metres[:23]).all()
    np.testing.assert_allclose(metres[25:], 1.0, atol=1e-3)
    assert (colours[25:, :, 0] > 100).all()
    assert (colours[25:, :, 1:] < 30).all()
    plant.close()


def test_points_of_frames_and_centres_agree(tmp_path, engine):
    turned = "position: [1, 2, 3], orientation_rpy: [0.3, -0.4, 0.5]"
    club = Row(box("club", 2.0, 0.4, 0.1, 0.2, centre="0.3 0 0.1"), turned)
    engine_ = make(tmp_path, engine, {"club": club}).physics.engine
    place, turn = engine_.frame((0, BASE))
    assert place == pytest.approx((1, 2, 3), abs=1e-6)
    assert turn == pytest.approx(quaternion((0.3, -0.4, 0.5)), abs=1e-6)
    assert engine_.inertial((0, BASE))[0] == pytest.approx((0.3, 0, 0.1), abs=1e-9)
    assert engine_.mass((0, BASE)) == pytest.approx(2.0)
    expected = (1, 2, 3) + rotation(turn) @ (0.3, 0, 0.1)
    np.testing.assert_allclose(engine_.centre(0)[0], expected, atol=1e-6)
    engine_.put_centre(0, ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)))
    np.testing.assert_allclose(engine_.frame((0, BASE))[0], (-0.3, 0, 0.9), atol=1e-6)


def test_a_state_that_is_saved_goes_on_to_the_bit(tmp_path, engine):
    bodies = {"ground": fixed(FLOOR)} | {
        name: Row(box(name, 1.0, 0.1, 0.1, 0.1), f"position: [{x}, 0, {z}]")
        for name, x, z in (("low", 0.0, 0.05), ("high", 0.03, 0.3))
    }
    first = advance(make(tmp_path, engine, bodies), 250)
    saved = first.physics.engine.save()
    if saved is None:
        pytest.skip(f"{engine} saves no state")
    other = make(tmp_path, engine, bodies)
    other.physics.engine.restore(saved)
    ends = [
        [plant.physics.engine.motion((body, BASE)) for body in (1, 2)]
        for plant in (advance(first, 200), advance(other, 200))
    ]
    assert ends[0] == ends[1]
