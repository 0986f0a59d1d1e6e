"""Range sensors on links: rays with a reach and noise in place of exact distances."""

import math

import numpy as np
import pybullet as bullet
import pytest
from support.services.devices import (
    box,
    joint,
    link,
    make_stand,
    write_can,
    write_ground,
    write_urdf,
)

from stepbus_plant.devices.proximity import RangeSkin
from stepbus_plant.devices.sensors.noise import Noise

WORLD = """
contacts:
  near: {links: [robot], within: 0.1}
bodies:
  ground: {urdf: ground.urdf, fixed_base: true}
  robot: {urdf: robot.urdf, fixed_base: true, position: [0, 0, 0.5]}
  can: {urdf: can.urdf, fixed_base: true, position: [AT]}
"""
SIDE = 0.2
RADIUS = 0.033


def measured(folder, at, *, noise=0.0, steps=1, spacing=0.03, reach=0.1):
    """Return what the sensors of a box of 0.2 m measure of a can, in each step."""
    write_ground(folder)
    write_can(folder)
    write_urdf(folder, "robot", link("robot", 1.0, box(f"{SIDE} {SIDE} {SIDE}")))
    stand = make_stand(
        folder,
        WORLD.replace("AT", at).replace("within: 0.1", f"within: {reach}"),
        {"near": "Contacts/1"},
        {},
        proximity={"spacing": spacing, "noise": noise},
    )
    found = []
    for step in range(steps):
        found.append(stand.participant.output(None)["near"])
        stand.update(step)
    return found


@pytest.mark.parametrize("gap", [0.004, 0.02, 0.06])
def test_a_ray_measures_how_far_a_thing_is_away(tmp_path, gap):
    contacts = measured(tmp_path, f"{SIDE / 2 + gap + RADIUS}, 0, 0.5")[0]
    assert contacts.pairs == [("can", "robot")]
    assert contacts.distance == pytest.approx([gap], abs=2e-3)
    assert contacts.force == [0.0]


def test_what_is_beyond_the_reach_is_not_measured(tmp_path):
    assert measured(tmp_path, f"{SIDE / 2 + 0.06 + RADIUS}, 0, 0.5", reach=0.05)[0].pairs == []


def test_a_corner_sees_what_comes_from_aside(tmp_path):
    aside = SIDE / 2 + 0.02 + RADIUS * 0.7
    contacts = measured(tmp_path, f"{aside}, {aside}, 0.5")[0]
    assert contacts.pairs == [("can", "robot")]
    assert 0.01 < contacts.distance[0] < 0.06


def test_a_sensor_below_sees_the_ground_far_from_which_the_robot_starts(tmp_path):
    world = f"{SIDE / 2 + 0.3}, 0, 0.5"
    contacts = measured(tmp_path, world, reach=0.45)[0]
    assert ("floor", "robot") in contacts.pairs
    assert contacts.distance[contacts.pairs.index(("floor", "robot"))] == pytest.approx(
        0.4, abs=2e-3
    )


def test_noise_is_relative_and_new_in_each_step(tmp_path):
    rows = measured(tmp_path, f"{SIDE / 2 + 0.05 + RADIUS}, 0, 0.5", noise=0.05, steps=100)
    gaps = np.array([row.distance[0] for row in rows])
    assert len(set(gaps)) == 100
    # The nearest of several rays.
    assert 0.001 < gaps.std() < 0.003
    assert 0.04 < gaps.mean() < 0.051


def test_the_same_run_measures_the_same(tmp_path):
    at = f"{SIDE / 2 + 0.05 + RADIUS}, 0, 0.5"
    one, other = (measured(tmp_path, at, noise=0.05, steps=5) for _ in range(2))
    assert [row.distance for row in one] == [row.distance for row in other]


def test_without_spacing_distances_are_exact(tmp_path):
    contacts = measured(tmp_path, f"{SIDE / 2 + 0.02 + RADIUS}, 0, 0.5", spacing=0.0)[0]
    assert contacts.distance == pytest.approx([0.02], abs=2e-3)


def test_a_touch_is_still_felt(tmp_path):
    write_ground(tmp_path)
    write_can(tmp_path)
    world = """
contacts:
  near: {links: [can], within: 0.1}
bodies:
  ground: {urdf: ground.urdf, fixed_base: true}
  can: {urdf: can.urdf, position: [0, 0, 0.0575]}
"""
    stand = make_stand(
        tmp_path, world, {"near": "Contacts/1"}, {}, proximity={"spacing": 0.03, "noise": 0.01}
    )
    for step in range(50):
        stand.update(step)
    contacts = stand.participant.output(None)["near"]
    assert contacts.pairs == [("can", "floor")]
    assert contacts.force == pytest.approx([0.35 * 9.81], rel=0.01)


SWING = """
contacts:
  near: {links: [bar], within: 0.3}
bodies:
  ground: {urdf: ground.urdf, fixed_base: true}
  arm: {urdf: arm.urdf, fixed_base: true, position: [0, 0, 0.5], joints: {hinge: {velocity: 2.0}}}
  can: {urdf: can.urdf, fixed_base: true, position: [0.25, 0, 0.5]}
"""


def test_ranges_of_a_link_that_moves_do_not_depend_on_other_sensors(tmp_path):
    write_ground(tmp_path)
    write_can(tmp_path)
    write_urdf(
        tmp_path,
        "arm",
        link("post", 1.0, box("0.01 0.01 0.01")),
        link("swing", 0.1, box("0.01 0.01 0.01")),
        link("bar", 2.0, box("0.2 0.1 0.1")),
        joint("hinge", "continuous", "post", "swing", "0 0 0", "0 0 1", "10 20"),
        joint("mount", "fixed", "swing", "bar", "0 0 0", "0 0 1", "0 0"),
    )

    def ranges(**others):
        outputs = {**others, "near": "Contacts/1"}
        stand = make_stand(tmp_path, SWING, outputs, {}, proximity={"spacing": 0.03, "noise": 0.0})
        found = []
        for step in range(8):
            found.append(stand.participant.output(None)["near"].distance)
            stand.update(step)
        return found

    assert ranges() == ranges(poses="Poses/1")


def skin_of(client, links, **settings):
    return RangeSkin(
        client,
        links,
        spacing=0.05,
        reach=0.1,
        noise=0.0,
        random=Noise(0, "proximity"),
        **settings,
    )


@pytest.mark.parametrize(("is_wheel", "sees"), [(False, True), (True, False)])
def test_sensors_turn_with_a_link_without_end_unless_it_is_a_wheel(tmp_path, is_wheel, sees):
    write_can(tmp_path)
    write_urdf(
        tmp_path,
        "table",
        link("foot", 1.0, box("0.05 0.05 0.05")),
        link("bar", 1.0, box("0.4 0.05 0.05")),
        joint("spin", "continuous", "foot", "bar", "0 0 0.2", "0 0 1", "1 1"),
    )
    client = bullet.connect(bullet.DIRECT)
    try:
        table = bullet.loadURDF(str(tmp_path / "table.urdf"), physicsClientId=client)
        at = (0.0, 0.2 + 0.03 + RADIUS, 0.2)
        can = bullet.loadURDF(str(tmp_path / "can.urdf"), at, physicsClientId=client)
        bar = (table, 0)
        skin = skin_of(client, [bar], wheels=[bar] if is_wheel else [])
        bullet.resetJointState(*bar, math.pi / 2, physicsClientId=client)
        bullet.performCollisionDetection(client)
        found = [reading.distance for _, reading in skin.sense({bar: [(can, -1)]})]
    finally:
        bullet.disconnect(client)
    assert found == ([pytest.approx(0.035, abs=5e-3)] if sees else [])


@pytest.mark.parametrize("beside", [0.0, 0.025, 0.1, 0.15, 0.225])
def test_a_post_between_two_rays_is_nearer_than_measured_by_less_than_a_centimetre(
    tmp_path, beside
):
    write_ground(tmp_path)
    write_urdf(tmp_path, "can", link("can", 1.0, '<cylinder radius="0.04" length="1"/>'))
    write_urdf(tmp_path, "robot", link("robot", 1.0, box("0.6 0.6 0.4")))
    world = WORLD.replace("AT", f"{0.3 + 0.04 + 0.04}, {beside}, 0.5")
    stand = make_stand(
        tmp_path, world, {"near": "Contacts/1"}, {}, proximity={"spacing": 0.05, "noise": 0.0}
    )
    (distance,) = stand.participant.output(None)["near"].distance
    assert 0.037 < distance < 0.05
