"""The file of a run's result."""

import json

from msgspec import structs

from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


def test_a_result_appears_whole(tmp_path):
    result = run(load("two_link", ["duration=10ms"]), Options(out=tmp_path, host=InProcess()))
    path = tmp_path / "result.json"
    with path.open() as reader:
        structs.replace(result, reason="another one").save()
        assert json.loads(reader.read())["reason"] == "finished"
    assert json.loads(path.read_text())["reason"] == "another one"
    assert not list(tmp_path.glob(".*"))


def test_the_cause_of_a_failure_names_neither_process_nor_folder(tmp_path):
    scenario = load("two_link", ["duration=100ms"], ["kill controller at 5"])
    result = run(scenario, Options(out=tmp_path / "out"))
    assert "controller was killed by SIGKILL" in result.cause
    assert result.reason.startswith("step 5 (t = 0.025 s): controller (pid ")
    assert result.reason.endswith(f"its log: {tmp_path}/out/logs/controller.log")
