"""A replay tests the program of the user's scenario, and says what is not as recorded."""

import json
import shutil
from pathlib import Path

import pytest
from support.tools import needs

from stepbus_orchestrator import cli
from stepbus_orchestrator.cli.new import write_starter
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.replay.trust import find_source
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import WiringError

REPLAY = ("--participant", "controller")


def record(folder, out, *overrides):
    """Record 50 ms of the scenario of a folder."""
    scenario = load(folder, ["duration=50ms", *overrides])
    result = run(scenario, Options(out=out, host=InProcess()))
    assert result.exit_code == 0, result.reason
    return result.recording


def edit(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


@pytest.fixture
def project(tmp_path, monkeypatch):
    """Return a folder with a scenario `arm`, whose folder is the current one."""
    root = tmp_path / "project"
    write_starter(root / "arm", "python")
    monkeypatch.chdir(root / "arm")
    return root


@pytest.fixture
def log(project):
    """Return a log kept as a test, without the folder of its run."""
    recording = record(project / "arm", project / "run")
    (project / "tests").mkdir()
    return recording.rename(project / "tests" / "kept.mcap")


@pytest.mark.parametrize("is_absolute", [False, True])
def test_a_folder_does_not_vouch_for_its_own_programs(project, monkeypatch, is_absolute):
    recording = record(project / "arm", project / "sent")
    (project / "arm").rename(project / "sent/arm")
    monkeypatch.chdir(project)
    named = Path("sent/arm/scenario.yaml")
    (project / "sent/result.json").write_text(
        json.dumps({"file": str(named.absolute() if is_absolute else named)})
    )
    with Recording(recording) as sent:
        assert find_source(sent) is None


def test_a_gain_changed_in_the_scenario_is_caught(project, log):
    edit(project / "arm/scenario.yaml", "kp: 200", "kp: 999")
    result = replay(log, "controller")
    assert not result.equal
    assert result.source == "scenario.yaml"
    assert list(result.changes) == ["controller.params.kp is 999, recorded 200 (scenario.yaml:17)"]
    assert "tested scenario.yaml, changed since the recording:\n  controller.params.kp is" in (
        result.text()
    )


def test_a_gain_changed_in_the_program_is_caught(project, log):
    edit(project / "arm/controller.py", "kp * error", "2 * kp * error")
    result = replay(log, "controller")
    assert (result.equal, list(result.changes)) == (
        False,
        ["controller.py:28 differs from the recorded one"],
    )


def test_a_failed_replay_shows_the_line_that_changed_below_the_first_divergence(project, log):
    edit(project / "arm/controller.py", "kp * error", "2 * kp * error")
    lines = replay(log, "controller").text().splitlines()
    assert lines[1].startswith("first divergence: step ")
    place = lines.index("  controller.py:28 differs from the recorded one")
    assert lines[place + 1 : place + 3] == [
        "--- recorded/controller.py",
        "+++ tested/controller.py",
    ]
    old, new = (line for line in lines[place + 3 :] if line[0] in "+-")
    assert new[1:] == old[1:].replace("kp * error", "2 * kp * error")


def test_what_is_as_recorded_is_equal_and_says_what_was_tested(log):
    result = replay(log, "controller")
    assert (result.equal, list(result.changes), list(result.notes)) == (True, [], [])
    assert "tested scenario.yaml, as recorded" in result.text()


def test_a_setting_of_the_replay_is_a_change(log):
    result = replay(log, "controller", set=["controller.params.kp=250"])
    assert (result.equal, list(result.changes)) == (False, ["--set controller.params.kp=250"])


def test_the_copy_is_tested_where_it_is_asked_for(project, log, capsys):
    edit(project / "arm/controller.py", "kp * error", "2 * kp * error")
    assert cli.main(["replay", str(log), *REPLAY]) == ExitCode.DIFFERENT
    assert cli.main(["replay", str(log), *REPLAY, "--recorded"]) == ExitCode.UNTRUSTED
    assert cli.main(["replay", str(log), *REPLAY, "--recorded", "--trust"]) == 0
    assert "tested" not in capsys.readouterr().out.splitlines()[-1]


def test_a_replay_without_a_work_tree_says_that_it_tests_the_copy(project, log, monkeypatch):
    monkeypatch.chdir(project)
    result = replay(log, "controller")
    assert result.equal
    assert result.notes[0].startswith("testing the copy in the recording, as its scenario is not")


def test_two_scenarios_of_the_name_are_named(project, log):
    shutil.copy(project / "arm/scenario.yaml", project / "arm/other.yaml")
    with pytest.raises(
        WiringError, match=r"several scenarios are named 'arm': .*choose with --source"
    ):
        replay(log, "controller")
    assert replay(log, "controller", source=project / "arm/other.yaml").source == "other.yaml"


def test_the_scenario_of_a_run_is_where_its_result_says(project, tmp_path, monkeypatch):
    recording = record(project / "arm", project / "run")
    edit(project / "arm/scenario.yaml", "kp: 200", "kp: 999")
    monkeypatch.chdir(tmp_path)
    assert list(replay(recording, "controller").changes) == [
        "controller.params.kp is 999, recorded 200 (scenario.yaml:17)"
    ]
    (project / "arm/scenario.yaml").chmod(0o666)
    assert find_source(Recording(recording)) is None


def test_a_source_without_the_scenario_is_refused(project, log):
    with pytest.raises(WiringError, match="has no scenario named 'arm'"):
        replay(log, "controller", source=project / "tests")


def test_what_the_scenario_connects_otherwise_is_replayed_as_recorded(project, log):
    edit(project / "arm/scenario.yaml", "seed: 0", "seed: 7")
    result = replay(log, "controller")
    assert result.equal
    assert list(result.changes) == [
        "seed: changed since the recording; the replay uses the recorded values"
    ]


def test_a_new_reference_has_the_files_of_the_work_tree(project, log, capsys):
    edit(project / "arm/scenario.yaml", "kp: 200", "kp: 150")
    edit(project / "arm/controller.py", '"""A PD', '"""My PD')
    new = project / "new.mcap"
    assert cli.main(["replay", str(log), *REPLAY, "--update", str(new)]) == ExitCode.DIFFERENT
    attached = Recording(new).attachments
    assert attached["files/controller.py"] == (project / "arm/controller.py").read_bytes()
    assert cli.main(["replay", str(new), *REPLAY, "--recorded"]) == 0
    assert list(replay(new, "controller").changes) == []


def test_of_a_shipped_scenario_the_copy_is_replayed(two_link_recording):
    assert find_source(Recording(two_link_recording)) is None


def test_a_program_of_ones_own_may_be_bridged(project, capsys):
    write_starter(project / "c_arm", "js")
    recording = record(project / "arm", project / "other", "duration=20ms")
    program = ["node", str(project / "c_arm/controller.mjs")]
    needs("node")
    assert replay(recording, "controller", program=program, bridge="json").steps == 4
    words = ["replay", str(project / "other"), *REPLAY, "--abs", "1e-9", "--bridge", "json"]
    assert cli.main([*words, "--exec", *program]) == 0


def test_a_scenario_that_others_may_write_is_not_yours(project, log, monkeypatch):
    file = project / "arm/scenario.yaml"
    assert find_source(Recording(log)) == file
    file.chmod(0o666)
    assert find_source(Recording(log)) is None
    assert find_source(Recording(log), project / "arm") == file
    assert cli.main(["replay", str(log), *REPLAY]) == ExitCode.UNTRUSTED
    file.chmod(0o644)
    monkeypatch.setattr("os.geteuid", lambda: file.stat().st_uid + 1)
    assert find_source(Recording(log)) is None


@pytest.mark.parametrize(
    "words", [("recover", "--out", "new.mcap"), ("diff", "../run"), ("rerun",)]
)
def test_the_folder_of_a_run_stands_for_its_recording(project, words):
    record(project / "arm", project / "run")
    assert cli.main([words[0], "../run", *words[1:]]) == 0
