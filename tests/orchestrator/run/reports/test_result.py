"""The file of a run's result."""

import json

import pytest

from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


@pytest.fixture
def result(tmp_path):
    return Result(
        scenario="two_link",
        outcome="finished",
        exit_code=0,
        reason="finished",
        participant=None,
        at_step=10,
        steps=10,
        step_ns=1_000_000,
        seed=0,
        window=8,
        transport="unix",
        start_s=0.5,
        wall_s=1.0,
        real_time_factor=0.01,
        sha256="",
        folder=str(tmp_path),
    )


def test_a_result_appears_whole(result, tmp_path):
    path = tmp_path / "result.json"
    path.write_text("what was there before")
    with path.open() as reader:
        result.save()
        assert reader.read() == "what was there before"
    assert json.loads(path.read_text())["steps"] == 10
    assert [item.name for item in tmp_path.iterdir()] == ["result.json"]


def test_the_cause_of_a_failure_names_neither_process_nor_folder(tmp_path):
    scenario = load("two_link", ["duration=100ms"], ["kill controller at 5"])
    result = run(scenario, Options(out=tmp_path / "out"))
    assert "controller was killed by SIGKILL" in result.cause
    assert result.reason.startswith("step 5 (t = 0.025 s): controller (pid ")
    assert result.reason.endswith(f"its log: {tmp_path}/out/logs/controller.log")
