"""Smoothing: it takes noise away, and its delay is what it says."""

import numpy as np
import pytest
from support.services.control import controller_config, make_controller

from stepbus_controller.controller import Controller
from stepbus_controller.smoothing import LowPass, MovingAverage
from stepbus_schemas import JointReference, JointState, WiringError

PERIOD = 0.005
PD = {"law": "pd", "kp": 100, "kd": 0, "joints": ["joint1", "joint2"], "effort_limit": 50}


@pytest.mark.parametrize("make", [lambda: LowPass(0.02, PERIOD), lambda: MovingAverage(9, PERIOD)])
def test_a_ramp_comes_later_by_the_stated_delay(make):
    smoother = make()
    for k in range(200):
        out = smoother.update(np.array([k * PERIOD]))
    assert out[0] == pytest.approx(199 * PERIOD - smoother.delay)


@pytest.mark.parametrize("make", [lambda: LowPass(0.02, PERIOD), lambda: MovingAverage(9, PERIOD)])
def test_noise_is_at_least_halved_and_the_first_sample_passes(make):
    smoother, noise = make(), np.random.default_rng(0).standard_normal((500, 1))
    out = [smoother.update(row) for row in noise]
    assert out[0] == pytest.approx(noise[0])
    assert np.std(out[50:]) < 0.6 * np.std(noise)


def test_a_moving_average_is_the_mean_of_its_window():
    smoother = MovingAverage(7, PERIOD)
    rows = np.random.default_rng(0).standard_normal((20, 2))
    out = [smoother.update(row) for row in rows]
    assert out[-1] == pytest.approx(rows[-7:].mean(axis=0))
    assert smoother.delay == pytest.approx(3 * PERIOD)


def test_the_controller_smooths_and_says_once_what_it_costs():
    config = controller_config(**PD, smoothing="low_pass", time_constant=0.02)
    controller = make_controller(config)
    zeros = [0.0, 0.0]
    wanted = JointReference(position=zeros, velocity=zeros, acceleration=zeros)
    first = controller.update(
        0, joint_state=JointState(position=zeros, velocity=zeros), reference=wanted
    )
    jump = JointState(position=[0.1, 0.0], velocity=zeros)
    second = controller.update(1, joint_state=jump)
    assert first["status"].warnings[0].endswith("by 17.6 ms")
    assert second["status"].warnings == []
    assert second["command"].values[0] == pytest.approx(-10 * (1 - np.exp(-0.25)))


def test_the_error_of_the_status_counts_from_the_measured_position_not_the_smoothed_one():
    config = controller_config(**PD, smoothing="low_pass", time_constant=0.5)
    controller, zeros = make_controller(config), [0.0, 0.0]
    reference = JointReference(position=zeros, velocity=zeros, acceleration=zeros)
    controller.update(
        0, joint_state=JointState(position=zeros, velocity=zeros), reference=reference
    )
    moved = JointState(position=[0.1, -0.2], velocity=zeros)
    assert controller.update(1, joint_state=moved)["status"].error == [-0.1, 0.2]


@pytest.mark.parametrize(
    ("params", "text"),
    [
        (
            {"smoothing": "lowpass"},
            "smoothing: must be none, low_pass or moving_average, not 'lowpass'; did you mean 'low_pass'",
        ),
        ({"smoothing": "low_pass"}, "time_constant: is needed with smoothing low_pass"),
        (
            {"smoothing": "low_pass", "time_constant": 0},
            "time_constant: must be a number above 0, not 0",
        ),
        ({"smoothing": "moving_average"}, "window: is needed with smoothing moving_average"),
    ],
)
def test_mistakes_in_smoothing_are_named(params, text):
    with pytest.raises(WiringError) as caught:
        Controller(controller_config(**PD, **params))
    (problem,) = str(caught.value).splitlines()
    assert text in problem
