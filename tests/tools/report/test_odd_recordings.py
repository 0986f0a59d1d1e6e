"""The report of a recording in which nothing moves, or numbers are none: no traceback."""

import math

import msgspec
import pytest

from stepbus_orchestrator.recording import McapFile, Recorder
from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_orchestrator.scenario.ports import OutputSpec
from stepbus_schemas import Description, JointReference, JointState, Outputs, encode
from stepbus_tools.run_lines import after_run

STEP_NS = 5_000_000
SINE = [math.sin(2 * math.pi * step / 200) for step in range(600)]
STILL = [0.0] * 600
NAN = [math.nan] * 600


def spec(name, port, type_name):
    outputs = {port: OutputSpec(type=type_name)}
    return ParticipantSpec(name=name, exec=("p",), outputs=outputs)


def record(path, positions, wanted):
    """Write one joint's positions, and those it should have had; wanted: none without a mission."""
    specs = [spec("plant", "joint_state", "JointState/1")]
    descriptions = {"plant": {"joint_state": Description(names=["knee"])}}
    if wanted:
        specs.append(spec("mission", "reference", "JointReference/1"))
        descriptions["mission"] = {"reference": Description(names=["knee"])}
    file = McapFile(path)
    recorder = Recorder(file, specs, STEP_NS)
    recorder.open_channels(descriptions, {})
    for step, x in enumerate(positions):
        state = JointState(position=[x], velocity=[0.0], effort=[x])
        offer(recorder, "plant", "joint_state", step, state)
        if wanted:
            offer(recorder, "mission", "reference", step, reference(wanted[step]))
    recorder.finish(len(positions), [])
    return path


def reference(r):
    return JointReference(position=[r], velocity=[0.0], acceleration=[-39.5 * r])


def offer(recorder, name, port, step, message):
    ports = {port: msgspec.Raw(encode(message))}
    recorder.offer(name, Outputs(token="", step=step, t_ns=step * STEP_NS, ports=ports))


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
