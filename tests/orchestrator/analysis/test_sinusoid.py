"""Joints that follow a sinusoid: amplitude and lag, also of one that never moves."""

import numpy as np
import pytest

from stepbus_orchestrator.analysis.signals import Signal, Tracking
from stepbus_orchestrator.analysis.sinusoid import fit_sinusoids, sinusoid_lines

T = np.arange(0.0, 10.0, 0.01)
OMEGA = 2 * np.pi


def signal(**fields):
    columns = {name: values[:, None] for name, values in fields.items()}
    return Signal(names=["knee"], steps=np.arange(len(T)), t=T, fields=columns)


def tracking(measured):
    wanted = np.sin(OMEGA * T)
    reference = signal(position=wanted, acceleration=-(OMEGA**2) * wanted)
    return Tracking(state=signal(position=measured), reference=reference, command=None)


def test_amplitude_and_lag_are_those_of_the_measured_sinusoid():
    (fit,) = fit_sinusoids(tracking(0.9 * np.sin(OMEGA * (T - 0.02))), after_s=2.0)
    assert (fit.wanted, fit.measured) == pytest.approx((1.0, 0.9))
    assert (fit.lag_s, fit.excess) == pytest.approx((0.02, -0.1))


@pytest.mark.parametrize("position", [0.0, 0.3])
def test_a_joint_that_never_moved_has_no_lag(position):
    (line, *_) = sinusoid_lines(tracking(np.full_like(T, position)), after_s=2.0)
    assert line == "sinusoid  knee: did not move; its reference has 57.296°"
