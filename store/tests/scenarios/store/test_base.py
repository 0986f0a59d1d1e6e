"""Something stands in the way of the store's base, or appears there: judged by the recording."""

import math

import numpy as np
import pytest
from support.runs.store import last, store

from stepbus_orchestrator.recording import Recording

pytestmark = pytest.mark.slow

STEP = 0.016
"""[s]"""

ROBOT = {"chassis", "left_wheel_link", "right_wheel_link", "front_caster", "back_caster", "hand"}


def script(*actions):
    return f"plant.params.script=[{', '.join(f'{{{action}}}' for action in actions)}]"


def touches(recording, link):
    """Return the force of each step in which the robot presses on a link [N]."""
    return [
        force
        for _, contacts in recording.messages("plant/contacts")
        for pair, force in zip(contacts.pairs, contacts.force, strict=True)
        if link in pair and force > 0.0 and ROBOT.intersection(pair)
    ]


def moved(recording, link, since):
    """Return how far a link has moved after a time [s] to the end [m]."""
    index = recording.ports["plant/poses"].description.names.index(link)
    places = [m.position[index] for k, m in recording.messages("plant/poses") if k * STEP > since]
    return math.dist(places[0], places[-1])


def true_speed(recording):
    """Return the speed of the chassis over the last poses [m/s]."""
    index = recording.ports["plant/poses"].description.names.index("chassis")
    rows = [(k, message.position[index]) for k, message in recording.messages("plant/poses")]
    (k0, one), (k1, other) = rows[-2:]
    return math.dist(one, other) / ((k1 - k0) * STEP)


def assert_stands(recording):
    assert true_speed(recording) < 1e-3
    assert np.abs(last(recording, "plant/joint_state").velocity).max() < 0.01


@pytest.mark.parametrize("seconds", [0, 0.8])
def test_the_base_drives_around_a_crate_that_stands_or_appears_on_its_line(tmp_path, seconds):
    crate = f"at: {seconds}s, body: crate, position: [0.95, 0.15, 0]"
    result = store(tmp_path, script(crate), "duration=36s")
    recording = Recording(result.recording)
    goals = [m.type for _, m in recording.messages("mission/goal")]
    assert "grip" in goals, result.reason  # it arrived in front of the shelf
    assert touches(recording, "crate_box") == []
    assert moved(recording, "crate_box", seconds + 0.1) < 1e-3


@pytest.mark.parametrize(
    ("overrides", "link", "since"),
    [
        ((script("at: 0s, body: crate, position: [0.95, 0.15, 0]"), "plant.params.stock.seed=90210"), "crate_box", 0.1),
        ((script("at: 0s, body: pillar, position: [0.9, 0.2, 0]"),), "pillar_post", 0.1),
        # On the curve that ends before it, in front of the shelf.
        ((script("at: 2.8s, body: pillar, position: [1.832, 0.161, 0]"),), "pillar_post", 2.9),
    ],
)  # fmt: skip
def test_what_stands_in_the_way_is_not_touched(tmp_path, overrides, link, since):
    result = store(tmp_path, *overrides, "duration=12s")
    recording = Recording(result.recording)
    assert touches(recording, link) == []
    assert moved(recording, link, since) < 1e-3
    if result.exit_code:
        assert_stands(recording)


def test_what_appears_within_the_braking_distance_is_left_at_once(tmp_path):
    crate = "body: crate, position: [1.2227, 0.3730, 0], orientation_rpy: [0, 0, 0.3892]"
    result = store(tmp_path, script(f"at: 1.872s, {crate}"), "duration=12s")
    recording = Recording(result.recording)
    assert 1 <= len(touches(recording, "crate_box")) < 10
    assert moved(recording, "crate_box", 1.94) < 0.06
    assert "mm by odometry, now " in result.reason
    gap = float(result.reason.partition("now ")[2].partition(" mm")[0])
    link = result.reason.partition(" touches crate_box")[0].split()[-1]
    rows = last(recording, "plant/contacts")
    (distance,) = [
        d
        for pair, d in zip(rows.pairs, rows.distance, strict=True)
        if set(pair) == {link, "crate_box"}
    ]
    assert 1e3 * distance == pytest.approx(gap, abs=0.5)
    assert_stands(recording)
