"""Participants in one process: the modules of their scenario, and none of another one."""

import sys

import pytest
from support.runs.joints import write_scenario

import stepbus
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load

SPEAKER = """
from stepbus import Event, Participant
import words

class Speaker(Participant):
    def update(self, step):
        import late
        print("at", step.index)
        return {"event": Event(level="info", text=words.WORD + late.WORD + self.config.name)}
"""


def write_speakers(folder, word, participant="speaker.py:Speaker"):
    """Write a scenario with two participants of one class, which says a word of its folder."""
    folder.mkdir(exist_ok=True)
    (folder / "speaker.py").write_text(SPEAKER)
    for name in ("words", "late"):
        (folder / f"{name}.py").write_text(f"WORD = {word!r}\n")
    rows = "".join(
        f"\n  {name}: {{participant: '{participant}', outputs: {{event: Event/1}}}}"
        for name in ("one", "two")
    )
    path = folder / "scenario.yaml"
    path.write_text(f"name: c\nstep: 10ms\nduration: 50ms\nparticipants:{rows}\n")
    return path


def said(result, name):
    assert result.exit_code == 0, result.reason
    messages = stepbus.Recording(result.recording)[f"{name}.event"].messages()
    return {message.text for _, message in messages}


@pytest.mark.parametrize("participant", ["speaker.py:Speaker", "speaker:Speaker"])
def test_a_class_of_the_folder_is_the_same_in_both_ways(tmp_path, participant):
    path = write_speakers(tmp_path / "source", "hello", participant)
    results = [
        stepbus.run(path, out=tmp_path / str(alone), in_process=alone) for alone in (False, True)
    ]
    assert said(results[1], "two") == {"hellohellotwo"}
    assert results[0].sha256 == results[1].sha256
    assert (tmp_path / "True/logs/one.log").read_text().split("\n")[4] == "at 4"
    assert not {"words", "late", "speaker"} & set(sys.modules)


@pytest.mark.parametrize("participant", ["speaker.py:Speaker", "speaker:Speaker"])
def test_a_later_run_has_the_files_as_they_are_then_and_of_its_own_folder(tmp_path, participant):
    for word, folder in (("a", "first"), ("bb", "first"), ("c", "second")):
        path = write_speakers(tmp_path / folder, word, participant)
        result = stepbus.run(path, out=tmp_path / word, in_process=True)
        assert said(result, "one") == {f"{word}{word}one"}


def test_a_module_of_the_callers_of_the_same_name_is_another(tmp_path, monkeypatch):
    own = type(sys)("speaker")
    monkeypatch.setitem(sys.modules, "speaker", own)
    result = stepbus.run(
        write_speakers(tmp_path / "source", "x"), out=tmp_path / "out", in_process=True
    )
    assert said(result, "one") == {"xxone"}
    assert sys.modules["speaker"] is own


@pytest.mark.parametrize("in_process", [False, True])
def test_no_folder_of_a_scenario_replaces_a_package_of_stepbus(tmp_path, in_process):
    source = tmp_path / "source"
    write_scenario(source)
    for name in ("stepbus_tools", "stepbus_mission"):
        (source / name).mkdir()
        (source / name / "__init__.py").write_text("raise SystemExit('replaced')\n")
    task = "mission={participant: 'stepbus_mission:Mission', outputs: {reference: JointReference/1}, params: {task: sine, joints: [hip, knee], amplitude: 1, omega: 1}}"
    options = Options(out=tmp_path / "out", host=host_of(in_process=in_process))
    result = run(load(source / "scenario.yaml", [task]), options)
    assert "replaced" not in result.reason
    assert result.exit_code == 0, result.reason
