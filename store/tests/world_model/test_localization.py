"""Where the base is: odometry that drifts, and landmarks that correct it."""

import math
from pathlib import Path

import numpy as np
import pytest

from stepbus_schemas import BaseState
from stepbus_store.world_model.localization import Localization
from stepbus_store.world_model.params import Params

UNCERTAINTY = Params(model=Path(), joints=())
MARKS = np.array([[2.0, -0.24], [2.0, 0.0], [2.0, 0.24], [0.0, 0.7], [0.2, 0.7]])


def state(x=0.0, y=0.0, yaw=0.0):
    return BaseState(x=x, y=y, yaw=yaw, vx=0.0, wz=0.0)


def seen_from(x, y, yaw, marks=MARKS):
    """Return where landmarks are in the frame of a base."""
    c, s = math.cos(yaw), math.sin(yaw)
    return [(c * (mx - x) + s * (my - y), c * (my - y) - s * (mx - x)) for mx, my in marks]


def driven(*poses):
    localization = Localization(MARKS, UNCERTAINTY)
    localization.predict(state())
    for pose in poses:
        localization.predict(state(*pose))
    return localization


def test_without_landmarks_it_is_odometry():
    localization = driven((0.5, 0.0, 0.3), (1.0, 0.2, 0.4), (1.0, 0.2, -0.4))
    assert localization.pose == pytest.approx((1.0, 0.2, -0.4))


def test_landmarks_correct_position_and_heading():
    localization = driven((1.5, 0.0, 0.0))
    for _ in range(5):
        assert localization.correct(seen_from(1.47, 0.02, 0.03, MARKS[:3])) == 3
    assert localization.pose == pytest.approx((1.47, 0.02, 0.03), abs=2e-3)


def test_a_correction_lasts_while_odometry_goes_on():
    localization = driven((1.5, 0.0, 0.0))
    for _ in range(5):
        localization.correct(seen_from(1.47, 0.02, 0.0, MARKS[:3]))
    localization.predict(state(1.0, 0.0, 0.0))
    assert localization.pose == pytest.approx((0.97, 0.02, 0.0), abs=3e-3)


def test_what_is_no_landmark_changes_nothing_but_the_certainty():
    localization = driven((1.5, 0.0, 0.0))
    before, deviation = localization.pose, localization.deviation
    assert localization.correct([(0.5, 0.12)]) == 0
    assert localization.pose == before
    assert (localization.deviation > deviation).all()


def test_doubt_has_a_limit():
    localization = driven((1.5, 0.0, 0.0))
    for _ in range(50):
        localization.correct([(0.5, 0.12)])
    assert localization.deviation.max() < 0.31


def test_a_filter_that_is_too_sure_finds_back():
    localization = driven()
    marks = MARKS[3:]
    for _ in range(20):
        localization.correct(seen_from(0.0, 0.0, 0.0, marks))
    for _ in range(20):
        localization.correct(seen_from(0.05, 0.03, 0.0, marks))
    assert localization.pose == pytest.approx((0.05, 0.03, 0.0), abs=6e-3)


def test_twenty_drives_do_not_drift():
    """Odometry is 2 % short in every drive: 1.2 m after all of them."""
    localization = Localization(MARKS, UNCERTAINTY)
    random, odometry = np.random.default_rng(1), 0.0
    localization.predict(state(odometry))
    for n in range(1, 21):
        true = 1.5 * (n % 2)
        odometry += (1.5 if n % 2 else -1.5) + 0.03
        localization.predict(state(odometry))
        for _ in range(3):
            noisy = np.array(seen_from(true, 0.0, 0.0)) + random.normal(0, 1e-3, (5, 2))
            localization.correct([tuple(row) for row in noisy.tolist()])
        assert localization.pose == pytest.approx((true, 0.0, 0.0), abs=3e-3)
