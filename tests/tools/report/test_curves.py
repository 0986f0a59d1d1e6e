"""The lines of the plots: few points that look like all of them, in little memory."""

import math
import tracemalloc

import numpy as np
import pytest
from support.messages.recordings import write
from support.runs.panels import curves, lines, reference

from stepbus_orchestrator.recording import Recording, source
from stepbus_schemas import JointCommand, JointState
from stepbus_tools.report.curves import Curve, JointCurves
from stepbus_tools.signals import TrackingError, tracking_pieces


def curve(count, piece, columns=1):
    """Return a curve of random walks, added piece by piece, with their times and values."""
    t = np.arange(float(count))
    values = np.random.default_rng(count).normal(size=(count, columns)).cumsum(axis=0)
    found = Curve()
    for start in range(0, count, piece):
        found.add(t[start : start + piece], values[start : start + piece])
    return found, t, values


def test_a_line_of_up_to_8000_points_is_all_there():
    found, t, values = curve(8000, 700)
    assert (found.line(0)[0] == t).all()
    assert (found.line(0)[1] == values[:, 0]).all()


@pytest.mark.parametrize("count", [8001, 30_011, 200_000])
@pytest.mark.parametrize("piece", [1777, 200_000])
def test_a_long_line_keeps_its_extremes_in_their_order(count, piece):
    found, _, values = curve(count, piece, columns=2)
    for index in (0, 1):
        thin, kept = found.line(index)
        assert 2000 <= len(thin) <= 9000
        assert (np.diff(thin) >= 0).all()
        assert (kept == values[thin.astype(int), index]).all()
        assert (kept.min(), kept.max()) == (values[:, index].min(), values[:, index].max())


def test_the_lines_of_several_pieces_are_those_of_one(record):
    recording = record(
        arm=("JointState/1", ["j"], [JointState(position=[math.sin(n)]) for n in range(50)]),
        goal=("JointReference/1", ["j"], [reference(n) if n % 5 == 2 else None for n in range(45)]),
        command=(
            "JointCommand/1",
            ["j"],
            [JointCommand(mode="torque", values=[n]) for n in range(9)],
        ),
    )
    whole, cut = (curves(*tracking_pieces(recording, size)) for size in (10**9, 60))
    assert len(list(tracking_pieces(recording, 60))) > 10
    for found in ("position", "velocity"):
        assert np.array_equal(lines(whole, found), lines(cut, found), equal_nan=True)
    assert np.array_equal(whole.error("j"), cut.error("j"), equal_nan=True)
    assert np.array_equal(whole.torques[0].of("values", "j"), cut.torques[0].of("values", "j"))


def test_a_velocity_that_is_not_sensed_is_the_slope_of_each_piece(record):
    states = [JointState(position=[math.sin(n)]) for n in range(50)]
    (piece,) = tracking_pieces(record(arm=("JointState/1", ["j"], states)))
    state = piece.states["plant/arm"]
    t, slope = curves(piece).state_of("j").of("velocity", "j")
    assert np.array_equal(slope, np.gradient(state.fields["position"][:, 0], t))


@pytest.mark.slow
def test_a_report_takes_as_much_memory_for_a_long_recording_as_for_a_short_one(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(source, "_CACHE_BYTES", 500_000)
    peaks = []
    for count in (20_000, 60_000):
        states = [JointState(position=[math.sin(0.01 * n)], target=[0.0]) for n in range(count)]
        path = write(tmp_path / f"{count}.mcap", arm=("JointState/1", ["j"], states))
        del states
        peaks.append(peak_of_a_report(path))
    assert peaks[1] < peaks[0] + 1_000_000


def peak_of_a_report(path):
    """Return the most memory [bytes] that reading a recording for its report takes."""
    with Recording(path) as recording:
        tracemalloc.start()
        found, error = JointCurves(), TrackingError(2.0)
        for piece in tracking_pieces(recording, 200_000):
            found.take(piece)
            error.take(piece)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    return peak
