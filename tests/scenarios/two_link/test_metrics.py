"""The metric of two_link: amplitude and lag of what follows a sinusoid."""

import runpy
from importlib import resources
from types import SimpleNamespace

import numpy as np
import pytest

FILE = resources.files("stepbus_scenarios") / "two_link/metrics.py"
T = np.arange(0.0, 10.0, 0.01)
OMEGA = 2 * np.pi
WANTED = np.sin(OMEGA * T)


class Port(dict):
    t, names = T, ["knee"]


def measure(measured, wanted=WANTED):
    reference = {"position": wanted[:, None], "acceleration": -(OMEGA**2) * wanted[:, None]}
    recording = {
        "mission/reference": Port(reference),
        "plant/joint_state": Port(position=measured[:, None]),
    }
    return SimpleNamespace(**runpy.run_path(str(FILE))).sinusoid(recording)


def test_amplitude_and_lag_are_those_of_the_measured_sinusoid():
    found = measure(0.9 * np.sin(OMEGA * (T - 0.02)))
    assert found == pytest.approx({"amplitude.knee": 0.9, "lag.knee": 0.02})


@pytest.mark.parametrize("position", [0.0, 0.3])
def test_a_joint_that_never_moved_has_no_lag(position):
    assert measure(np.full_like(T, position)) == {"amplitude.knee": 0.0, "lag.knee": None}


def test_a_joint_that_should_stand_still_has_no_figures():
    assert measure(T, wanted=np.zeros_like(T)) == {}
