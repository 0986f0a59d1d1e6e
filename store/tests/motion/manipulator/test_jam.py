"""A joint that jams is noticed by what it does not do, and stays where it is."""

import re

import numpy as np
import pytest
from support.services.manipulator import PERIOD, Log, Stage, make_arm
from support.services.ur5 import joints_goal

LAG = 0.02
ELBOW = 2


class _Jammed:
    """Motors that follow their commands, but for one joint from some step on."""

    def __init__(self, joint: int, step: int) -> None:
        self._joint, self._left = joint, step
        self._at = 0.0

    def __call__(self, q, v):
        self._left -= 1
        q, v = q + v * PERIOD, v.copy()
        if self._left <= 0:
            q[self._joint], v[self._joint] = self._at, 0.0
        self._at = q[self._joint]
        return q, v


def _text_after(stage, steps):
    """Return the step and the sentence of the first jam; None: there was none."""
    log = Log()
    for number in range(steps):
        if text := stage.arm.jam(stage.q, None, stage.t):
            return number, text
        stage.step(log)
    return None


def test_a_joint_that_does_not_follow_is_named_and_left_alone(robot):
    stage = Stage(make_arm(robot, jam_lag=LAG), motor=_Jammed(ELBOW, 40))
    stage.start(joints_goal())
    found = _text_after(stage, 200)
    assert found is not None
    number, text = found
    assert 40 <= number < 60
    assert re.match(r"elbow_joint is 1\.\d° behind", text)
    stays, before = stage.q[ELBOW], stage.arm.at(stage.t)
    log = Log()
    for _ in range(100):
        stage.step(log)
    assert np.allclose(np.array(log.q)[1:, ELBOW], stays)
    assert np.abs(np.array(log.v)[-1]).max() == 0.0
    assert np.abs(np.array(log.q)[0] - before.position).max() < LAG + 1e-3


@pytest.mark.parametrize("left", [20, 30])
def test_a_joint_that_jams_shortly_before_the_goal_is_named_too(robot, left):
    stage = Stage(make_arm(robot, jam_lag=LAG))
    number = stage.run(joints_goal()).steps
    stage = Stage(
        make_arm(robot, jam_lag=LAG, settle_timeout=3.0), motor=_Jammed(ELBOW, number - left)
    )
    stage.start(joints_goal())
    found = _text_after(stage, number + 200)
    assert found is not None
    assert re.match(r"elbow_joint is \d\.\d° behind: is it jammed", found[1])
    assert number < found[0] < number + 150


def test_joints_that_follow_do_not_jam(robot):
    stage = Stage(make_arm(robot, jam_lag=LAG))
    stage.start(joints_goal())
    assert _text_after(stage, 400) is None
    assert _text_after(Stage(make_arm(robot), motor=_Jammed(ELBOW, 1)), 50) is None
