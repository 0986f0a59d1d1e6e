"""The skin of a robot: distances within its range, with errors of calibration and noise."""

import math

import numpy as np
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
EXACT_BUT = 1e-9
"""Errors so small that only the way of measuring is left."""


def measured(folder, at, *, gain=0.0, noise=EXACT_BUT, steps=1, reach=0.1, thing=None):
    """Return what the skin of a box of 0.2 m measures of a can, in each step.

    thing: URDF shape in place of the can's.
    """
    write_ground(folder)
    write_can(folder)
    if thing is not None:
        write_urdf(folder, "can", link("can", 1.0, thing))
    write_urdf(folder, "robot", link("robot", 1.0, box(f"{SIDE} {SIDE} {SIDE}")))
    stand = make_stand(
        folder,
        WORLD.replace("AT", at).replace("within: 0.1", f"within: {reach}"),
        {"near": "Contacts/1"},
        {},
        proximity={"gain": gain, "noise": noise},
    )
    found = []
    for step in range(steps):
        found.append(stand.participant.output(None)["near"])
        stand.update(step)
    return found


@pytest.mark.parametrize("gap", [0.004, 0.02, 0.06])
def test_the_skin_measures_how_far_a_thing_is_away(tmp_path, gap):
    contacts = measured(tmp_path, f"{SIDE / 2 + gap + RADIUS}, 0, 0.5")[0]
    assert contacts.pairs == [("can", "robot")]
    assert contacts.distance == pytest.approx([gap], abs=2e-3)
    assert contacts.force == [0.0]


@pytest.mark.parametrize("angle", range(0, 360, 30))
@pytest.mark.parametrize("radius", [0.004, 0.04])
def test_no_rod_or_post_is_in_a_blind_spot(tmp_path, angle, radius):
    direction = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    # From the surface of the box outwards, so far that 40 mm are left.
    x, y = direction * (SIDE / 2 / np.abs(direction).max())
    x, y = np.array([x, y]) + direction * (0.04 + radius)
    rod = f'<cylinder radius="{radius}" length="1"/>'
    contacts = measured(tmp_path, f"{x}, {y}, 0.5", thing=rod)[0]
    gap = math.hypot(max(abs(x) - SIDE / 2, 0.0), max(abs(y) - SIDE / 2, 0.0)) - radius
    assert contacts.distance == pytest.approx([gap], abs=2e-3)


def test_what_the_robot_does_not_stand_on_is_measured_below_it_too(tmp_path):
    contacts = measured(tmp_path, f"{SIDE / 2 + 0.3}, 0, 0.5", reach=0.45)[0]
    assert ("floor", "robot") in contacts.pairs
    assert contacts.distance[contacts.pairs.index(("floor", "robot"))] == pytest.approx(
        0.4, abs=2e-3
    )


def test_noise_is_relative_and_new_in_each_step(tmp_path):
    rows = measured(tmp_path, f"{SIDE / 2 + 0.05 + RADIUS}, 0, 0.5", noise=0.05, steps=100)
    gaps = np.array([row.distance[0] for row in rows])
    assert len(set(gaps)) == 100
    assert gaps.mean() == pytest.approx(0.05, rel=0.04)
    assert gaps.std() == pytest.approx(0.05 * 0.05, rel=0.25)


def test_an_error_of_calibration_is_the_same_in_all_steps(tmp_path):
    rows = measured(tmp_path, f"{SIDE / 2 + 0.05 + RADIUS}, 0, 0.5", gain=0.05, noise=0, steps=10)
    gaps = {row.distance[0] for row in rows}
    assert len(gaps) == 1
    assert 1e-4 < abs(gaps.pop() - 0.05) < 0.01


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
        tmp_path, world, {"near": "Contacts/1"}, {}, proximity={"gain": 0.05, "noise": 0.01}
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


def test_distances_of_a_link_that_moves_do_not_depend_on_other_sensors(tmp_path):
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

    def distances(**others):
        outputs = {**others, "near": "Contacts/1"}
        stand = make_stand(tmp_path, SWING, outputs, {}, proximity={"gain": 0.05})
        found = []
        for step in range(8):
            found.append(stand.participant.output(None)["near"].distance)
            stand.update(step)
        return found

    assert distances() == distances(poses="Poses/1")
