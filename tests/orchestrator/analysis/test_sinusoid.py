"""Joints that follow a sinusoid: amplitude and lag, also of one that never moves."""

import numpy as np
import pytest

from stepbus_orchestrator.analysis.signals import Signal, Tracking
from stepbus_orchestrator.analysis.sinusoid import JointMotions

T = np.arange(0.0, 10.0, 0.01)
OMEGA = 2 * np.pi


def signal(**fields):
    columns = {name: values[:, None] for name, values in fields.items()}
    return Signal(names=["knee"], steps=np.arange(len(T)), t=T, fields=columns)


def tracking(measured):
    wanted = np.sin(OMEGA * T)
    reference = signal(position=wanted, acceleration=-(OMEGA**2) * wanted)
    return Tracking(states={"a": signal(position=measured)}, references={"b": reference})


def motions(pieces):
    found = JointMotions()
    for piece in pieces:
        found.take(piece)
    return found


def cut(whole, at):
    """Return a tracking in two pieces."""
    rows = slice(0, at), slice(at, None)
    parts = [(whole.state.slice(r), whole.reference.slice(r)) for r in rows]
    return [
        Tracking(states={"a": state}, references={"b": reference}) for state, reference in parts
    ]


def test_amplitude_and_lag_are_those_of_the_measured_sinusoid():
    pieces = [tracking(0.9 * np.sin(OMEGA * (T - 0.02)))]
    (fit,) = motions(pieces).fits(pieces, after_s=2.0)
    assert (fit.wanted, fit.measured) == pytest.approx((1.0, 0.9))
    assert (fit.lag_s, fit.excess) == pytest.approx((0.02, -0.1))


@pytest.mark.parametrize("position", [0.0, 0.3])
def test_a_joint_that_never_moved_has_no_lag(position):
    pieces = [tracking(np.full_like(T, position))]
    (line, *_) = motions(pieces).lines(pieces, after_s=2.0)
    assert line == "sinusoid  knee: did not move; its reference has 57.296°"


@pytest.mark.parametrize("at", [1, 3, 500, 999])
def test_a_fit_over_several_pieces_is_that_over_one(at):
    whole = tracking(0.9 * np.sin(OMEGA * (T - 0.02)) + 0.01 * np.sin(3.3 * T))
    (one,) = motions([whole]).fits([whole], after_s=2.0)
    pieces = cut(whole, at)
    (other,) = motions(pieces).fits(pieces, after_s=2.0)
    expected = (one.wanted, one.measured, one.lag_s)
    assert (other.wanted, other.measured, other.lag_s) == pytest.approx(expected, abs=1e-12)


def test_a_reference_that_leaves_its_sinusoid_in_a_later_piece_is_none():
    wanted = np.sin(OMEGA * T)
    acceleration = -(OMEGA**2) * wanted
    acceleration[900] += 1e-3
    reference = signal(position=wanted, acceleration=acceleration)
    pieces = cut(Tracking(states={"a": signal(position=wanted)}, references={"b": reference}), 500)
    assert motions(pieces).fits(pieces, after_s=2.0) == []
