"""Participants in one process: each has its own modules, arguments and folder."""

import sys
from pathlib import Path
from types import ModuleType

from support.runs.joints import write_scenario

import stepbus
from stepbus_orchestrator import Options, load
from stepbus_orchestrator.run.inprocess.program import Program
from stepbus_orchestrator.run.run_scenario import run


def test_a_scenario_above_the_packages_of_stepbus_does_not_load_them_again(monkeypatch):
    program = Program(["worker.py"], Path(stepbus.__file__).parents[1])
    before = sys.modules["stepbus"]
    module = ModuleType("extra")
    module.__file__ = stepbus.__file__
    program.enter()
    monkeypatch.setitem(sys.modules, "stepbus.extra_for_a_test", module)
    program.leave()
    assert sys.modules["stepbus.extra_for_a_test"] is module
    assert sys.modules["stepbus"] is before


ARGUMENTS = """
import sys
from stepbus import Event, Participant, main

class Speaker(Participant):
    def update(self, step):
        return {"event": Event(level="info", text=sys.argv[1])}

raise SystemExit(main(Speaker))
"""


def test_each_participant_keeps_its_own_arguments(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    (source / "speaker.py").write_text(ARGUMENTS)
    rows = "".join(
        f"\n  {name}: {{exec: [python, speaker.py, {name}], outputs: {{event: Event/1}}}}"
        for name in ("one", "two")
    )
    (source / "scenario.yaml").write_text(
        f"name: c\nstep: 10ms\nduration: 30ms\nparticipants:{rows}\n"
    )
    result = stepbus.run(source / "scenario.yaml", out=tmp_path / "out", in_process=True)
    assert result.exit_code == 0, result.reason
    recording = stepbus.Recording(result.recording)
    for name in ("one", "two"):
        assert {message.text for _, message in recording[f"{name}.event"].messages()} == {name}


COUNTER = """
from stepbus import Event, Participant, main
import counting

class Counter(Participant):
    def update(self, step):
        import late
        counting.count += 1
        late.count += 1
        print("at", step.index)
        return {"event": Event(level="info", text=f"{counting.count} {late.count}")}

if __name__ == "__main__":
    raise SystemExit(main(Counter))
"""


def test_modules_of_the_scenario_belong_to_one_participant_each(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    for name in ("counting", "late"):
        (source / f"{name}.py").write_text("count = 0\n")
    (source / "counter.py").write_text(COUNTER)
    rows = "".join(
        f"\n  {name}: {{exec: [python, counter.py], outputs: {{event: Event/1}}}}"
        for name in ("one", "two")
    )
    (source / "scenario.yaml").write_text(
        f"name: c\nstep: 10ms\nduration: 50ms\nparticipants:{rows}\n"
    )
    results = [
        stepbus.run(source / "scenario.yaml", out=tmp_path / str(alone), in_process=alone)
        for alone in (False, True)
    ]
    assert results[0].sha256 == results[1].sha256
    last = stepbus.Recording(results[1].recording)["two.event"].messages()
    assert [message.text for _, message in last][-1] == "5 5"
    assert (tmp_path / "True/logs/one.log").read_text().split("\n")[4] == "at 4"
    assert not {"counting", "late", "counter"} & set(sys.modules)


def test_no_folder_of_a_scenario_replaces_a_package_of_stepbus(tmp_path):
    source = tmp_path / "source"
    write_scenario(source)
    for name in ("stepbus_selftest", "stepbus_mission"):
        (source / name).mkdir()
        for file in ("__init__", "__main__"):
            (source / name / f"{file}.py").write_text("raise SystemExit('replaced')\n")
    task = "mission={exec: [python, -m, stepbus_mission], outputs: {reference: JointReference/1}, params: {task: sine, joints: [hip, knee], amplitude: 1, omega: 1}}"
    result = run(
        load(source / "scenario.yaml", [task]), Options(out=tmp_path / "out", in_process=True)
    )
    assert "replaced" not in result.reason
    assert result.exit_code == 0, result.reason
