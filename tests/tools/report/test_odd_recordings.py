"""The report of a recording in which nothing moves, or numbers are none: no traceback."""

import math

import pytest
from support.messages.recordings import write

from stepbus_schemas import JointReference, JointState
from stepbus_tools.run_lines import after_run

STEP_NS = 5_000_000
SINE = [math.sin(2 * math.pi * step / 200) for step in range(600)]
STILL = [0.0] * 600
NAN = [math.nan] * 600


def record(path, positions, wanted):
    """Write one joint's positions, and those it should have had; wanted: none without a mission."""
    states = [JointState(position=[x], velocity=[0.0], effort=[x]) for x in positions]
    ports = {"joint_state": ("JointState/1", ["knee"], states)}
    if wanted:
        ports["reference"] = ("JointReference/1", ["knee"], list(map(reference, wanted)))
    return write(path, STEP_NS, **ports)


def reference(r):
    return JointReference(position=[r], velocity=[0.0], acceleration=[-39.5 * r])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("positions", "wanted", "line"),
    [
        ([], [], "no report"),
        ([0.0], [], "plots"),
        ([0.0, math.inf], [], "plots"),
        ([0.0], [1.0], "tracking RMSE of the whole run: knee 1 rad"),
        (STILL, STILL, "tracking RMSE after 2 s: knee 0 rad"),
        (STILL, SINE, "tracking RMSE after 2 s: knee 0.707 rad"),
        (NAN, SINE, "tracking RMSE after 2 s: knee nan rad"),
        ([*SINE[:500], math.nan, *SINE[501:]], SINE, "tracking RMSE after 2 s: knee nan rad"),
        (SINE, NAN, "plots"),
        ([1e200] * 600, SINE, "tracking RMSE after 2 s: knee inf rad"),
    ],
)
def test_it_has_a_report(tmp_path, positions, wanted, line):
    lines = after_run(record(tmp_path / "run.mcap", positions, wanted), has_plots=True)
    assert lines[0].startswith(line)
