"""Runs, recordings and scenarios from Python."""

import dataclasses
import threading
from pathlib import Path

import numpy as np
import pytest

import stepbus
import stepbus_scenarios
from stepbus import messages
from stepbus_orchestrator.run.result import result_beside

TWO_LINK = Path(stepbus_scenarios.__file__).parent / "two_link"
SHORT = {"duration": "100ms"}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    out = tmp_path_factory.mktemp("api") / "run"
    return stepbus.run("two_link", set=SHORT, out=out, in_process=True)


def as_python(duration="100ms"):
    """Return the scenario two_link, as a map."""
    rows = {
        spec.name: {
            "participant": spec.participant,
            "publishes": spec.publishes,
            "inputs": {port: f"{item.source}.{item.port}" for port, item in spec.inputs.items()},
            "outputs": {
                port: getattr(messages, item.type[:-2]) for port, item in spec.outputs.items()
            },
            "params": spec.params,
        }
        for spec in stepbus.load("two_link").participants
    }
    return {"name": "two_link", "step": "5ms", "duration": duration, "participants": rows}


def test_a_run_returns_its_result(result):
    assert (result.outcome, result.steps, result.simulated_s) == ("finished", 20, 0.1)


def test_a_scenario_in_python_is_the_one_of_the_file():
    from_file = stepbus.load("two_link", set=SHORT)
    assert dataclasses.replace(stepbus.load(as_python(), folder=TWO_LINK), window=64) == from_file


def run_map(scenario, out):
    return stepbus.run(stepbus.load(scenario, set=SHORT, folder=TWO_LINK), out=out)


def test_a_scenario_in_python_gives_the_same_recording(result, tmp_path):
    assert run_map(as_python("10s"), tmp_path / "run").sha256 == result.sha256


def test_a_scenario_is_loaded_once_and_prints_in_a_line():
    loaded = stepbus.load("two_link", set=SHORT)
    assert isinstance(loaded, stepbus.Scenario)
    assert stepbus.load(loaded) is loaded
    assert repr(loaded).startswith("<Scenario two_link: 20 steps of 5 ms,")
    with pytest.raises(stepbus.WiringError, match="two_link is already loaded; pass `set`"):
        stepbus.run(loaded, set=SHORT)
    with pytest.raises(stepbus.WiringError, match="only valid with a scenario given as a"):
        stepbus.load("two_link", folder=TWO_LINK)


def test_all_mistakes_of_a_scenario_in_python_are_listed():
    plant = {"participant": "stepbus_plant:Plant", "inputs": {"command": "controler.x"}}
    scenario = {"name": "arm", "step": "5", "windw": 3, "participants": {"plant": plant}}
    with pytest.raises(stepbus.ScenarioError) as caught:
        stepbus.load(scenario, folder=TWO_LINK)
    text = str(caught.value)
    assert "did you mean 'window'?" in text
    assert "no participant 'controler'" in text
    assert "scenario: step: " in text


def test_values_of_python_reach_the_scenario():
    values = {
        "controller.params.kp": np.array([80.0, 1e-9]),
        "controller.params.limits": {"a b": (1, -2.5e20), "inf": float("inf"), "text": "yes: #1"},
        "controller.params.path": Path("a/b"),
    }
    scenario = as_python()
    del scenario["participants"]["controller"]["participant"]
    scenario["participants"]["controller"].update(exec=["python", "-c", "pass"])
    loaded = stepbus.load(scenario, set=values, folder=TWO_LINK)
    params = loaded.participant("controller").params
    assert params["kp"] == [80.0, 1e-9]
    assert params["limits"] == {"a b": [1, -2.5e20], "inf": float("inf"), "text": "yes: #1"}
    assert params["path"] == "a/b"


def test_faults_and_the_interrupt_end_a_run(tmp_path):
    crashed = stepbus.run("two_link", set=SHORT, out=tmp_path / "1", faults=["kill plant at 5"])
    assert (crashed.exit_code, crashed.participant) == (stepbus.ExitCode.DIED, "plant")
    interrupt = threading.Event()
    interrupt.set()
    ended = stepbus.run("two_link", out=tmp_path / "2", interrupt=interrupt, in_process=True)
    assert ended.exit_code == stepbus.ExitCode.INTERRUPTED


def test_an_observer_sees_the_run(tmp_path):
    class Seen:
        phases, events = [], []

        def progress(self, progress: stepbus.Progress) -> None:
            self.phases.append(progress.phase)

        def event(self, level, who, step, text):
            self.events.append((level, who, step, text))

    faults = ["delay controller at 3 for 20ms"]
    stepbus.run("two_link", set=SHORT, out=tmp_path / "run", observer=Seen(), faults=faults)
    assert "starting" in Seen.phases
    assert any("fault injected" in text for *_, text in Seen.events)


@pytest.mark.parametrize("source", ["result", "folder", "file"])
def test_a_recording_is_named_by_its_result_folder_or_file(result, source):
    where = {"result": result, "folder": result.folder, "file": result.recording}[source]
    recording = stepbus.Recording(where)
    assert recording["plant.joint_state"].position.shape == (21, 2)
    assert stepbus.diff(where, result).equal


def test_a_recording_runs_again_and_is_recovered(result, tmp_path):
    assert stepbus.rerun(result, tmp_path / "again").equal
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(result.recording.read_bytes()[:-100])
    stepbus.recover(cut, tmp_path / "whole.mcap")
    assert (tmp_path / "whole.mcap").read_bytes() == result.recording.read_bytes()


def test_describe_lists_the_ports():
    plant = stepbus.describe("two_link")[0]
    assert (plant.participant, plant.outputs[0].joints[0].name) == ("plant", "joint1")


@pytest.mark.slow
def test_verify_keeps_only_what_differs(tmp_path):
    found = stepbus.verify("two_link", runs=2, set=SHORT, out=tmp_path / "kept")
    assert (found.failed, found.different) == (None, None)
    assert sorted(path.name for path in (tmp_path / "kept").iterdir()) == ["1", "2"]


def test_a_run_in_real_time_reports_how_late_its_steps_were_and_plots_it(result, tmp_path):
    timed = stepbus.run("two_link", set=SHORT, out=tmp_path / "out", in_process=True, real_time=20)
    assert timed.sha256 == result.sha256
    assert timed.real_time.factor == 20
    with stepbus.Recording(timed) as recording:
        assert result_beside(recording).real_time == timed.real_time


@pytest.mark.parametrize("factor", [0, -1, float("nan"), float("inf")])
def test_real_time_takes_a_factor(factor, tmp_path):
    with pytest.raises(stepbus.WiringError, match="real_time must be a factor from"):
        stepbus.run("two_link", out=tmp_path / "out", real_time=factor)


def test_a_failed_result_raises_when_checked_and_prints_in_a_line(tmp_path):
    result = stepbus.run(
        "two_link", set=SHORT, out=tmp_path / "out", faults=["kill controller at 5"]
    )
    assert repr(result).startswith("<Result two_link: failed after 5 steps")
    with pytest.raises(stepbus.RunFailure) as caught:
        result.check()
    assert (caught.value.code, caught.value.participant) == (result.exit_code, "controller")
    finished = stepbus.run("two_link", set=SHORT, out=tmp_path / "second", in_process=True)
    assert finished.check() is finished
