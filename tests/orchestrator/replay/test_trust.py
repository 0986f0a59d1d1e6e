"""The programs of a recording that was made elsewhere start only when somebody says so."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from support.runs.joints import run_joints

from stepbus_orchestrator import cli
from stepbus_orchestrator.errors import ExitCode, RecordingFailed
from stepbus_orchestrator.recording import Recording, known_programs
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.replay.programs.trust import programs_of
from stepbus_orchestrator.replay.rerun import Preparation

STEPBUS = str(Path(sys.executable).with_name("stepbus"))
REPLAY = ("--participant", "controller", "--recorded")


@pytest.fixture
def recorded(tmp_path):
    """Return a recording whose programs this user has run here."""
    return run_joints(tmp_path, "duration=50ms", in_process=True).recording


@pytest.fixture
def stranger(recorded, tmp_path, monkeypatch):
    """Return the same recording where nobody has run its programs: at another user's, say."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return recorded


@pytest.fixture
def unstarted(stranger, monkeypatch):
    """Return the recording, when no process can be started any more."""

    def refuse(*_args, **_options):
        raise AssertionError("a process was started")

    monkeypatch.setattr(subprocess.Popen, "__init__", refuse)
    monkeypatch.setattr(subprocess.Popen, "__del__", lambda _: None)
    return stranger


@pytest.mark.parametrize("words", [("rerun",), ("replay", *REPLAY)])
def test_a_strangers_recording_names_its_programs_and_starts_none(
    unstarted, tmp_path, capsys, monkeypatch, words
):
    monkeypatch.chdir(tmp_path)
    assert cli.main([words[0], str(unstarted), *words[1:]]) == ExitCode.UNTRUSTED == 12
    said = capsys.readouterr().err
    assert f"{unstarted} was not made by you on this machine. It starts, with your rights:" in said
    assert "\n  controller  joints.py:Controller\n" in said
    assert "\n  its files: joints.py\n" in said
    assert ("mission" in said) == (words[0] == "rerun")
    assert said.endswith("nothing was started; if you trust that, use --trust\n")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("words", [("rerun", "--out", "again"), ("replay", *REPLAY)])
def test_trust_is_asked_for_once(stranger, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    command, *options = words
    assert cli.main([command, str(stranger), *options, "--trust"]) == 0
    assert programs_of(Recording(stranger)).is_known
    assert cli.main(["replay", str(stranger), *REPLAY]) == 0


def test_a_recording_of_ones_own_is_trusted_wherever_it_lies(recorded, tmp_path):
    moved = recorded.rename(tmp_path / "moved.mcap")
    assert cli.main(["replay", str(moved), *REPLAY]) == 0


def test_a_new_reference_is_trusted_like_the_run_it_comes_from(recorded, tmp_path):
    new, other = tmp_path / "new.mcap", "controller.params={fault: end, at: 4}"
    update = ["--update", str(new), "--set", other]
    assert cli.main(["replay", str(recorded), *REPLAY, *update]) in {0, 10}
    assert programs_of(Recording(new)).is_known


def test_the_same_programs_with_another_file_are_strangers(recorded):
    scenario, files = b"x", {"joints.py": b"pass"}
    known_programs.remember(known_programs.fingerprint(scenario, files))
    assert known_programs.is_known(known_programs.fingerprint(scenario, files))
    for other in ({"joints.py": b"pass "}, {"joint.py": b"pass"}, {}):
        assert not known_programs.is_known(known_programs.fingerprint(scenario, other))


def test_a_program_of_ones_own_needs_trust_only_where_it_could_run_a_file(stranger):
    with_code = programs_of(Recording(stranger), "controller", own_program=True)
    assert (with_code.commands, list(with_code.files)) == ({}, ["joints.py"])
    assert not with_code.is_harmless


def test_a_program_of_ones_own_needs_no_trust_for_data(two_link_recording, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    program = ["--exec", sys.executable, "-m", "stepbus_participant"]
    program.append("stepbus_controller:Controller")
    assert cli.main(["replay", str(two_link_recording), *REPLAY, *program]) == 0


def test_from_python_who_names_a_recording_trusts_it(stranger):
    assert replay(stranger, "controller").equal


def test_a_recording_that_changes_after_the_question_is_refused(stranger, tmp_path):
    with pytest.raises(RecordingFailed, match="has changed since it was checked"):
        replay(stranger, "controller", trusted="0" * 64)
    with pytest.raises(RecordingFailed, match="has changed since it was checked"):
        Preparation(stranger, tmp_path / "again", trusted="0" * 64)
    assert not (tmp_path / "again").exists()


@pytest.mark.parametrize(("answer", "code"), [("y", 0), ("n", 12), ("", 12), ("yes", 0)])
def test_on_a_terminal_it_asks(stranger, answer, code):
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [STEPBUS, "replay", str(stranger), *REPLAY],
        stdin=theirs, stdout=subprocess.DEVNULL, stderr=theirs,
    )  # fmt: skip
    os.close(theirs)
    said = b""
    while b"Start that? [y/N] " not in said:
        said += os.read(ours, 1000)
    os.write(ours, f"{answer}\n".encode())
    assert process.wait(60) == code
    os.close(ours)
    assert b"controller  joints.py:Controller\r\n" in said


@pytest.mark.parametrize("spoil", ["a link", "others may write", "a folder", "no home"])
def test_a_list_that_others_could_have_written_is_not_believed(tmp_path, monkeypatch, spoil):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    known_programs.remember("f" * 64)
    assert known_programs.is_known("f" * 64)
    path = tmp_path / "stepbus" / "programs"
    assert path.stat().st_mode & 0o777 == 0o600
    if spoil == "a link":
        path.rename(tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
    elif spoil == "others may write":
        path.chmod(0o666)
    elif spoil == "a folder":
        path.unlink()
        path.mkdir()
    else:
        monkeypatch.setenv("XDG_STATE_HOME", "relative")
        monkeypatch.setenv("HOME", "/dev/null")
    assert not known_programs.is_known("f" * 64)
    known_programs.remember("e" * 64)
    assert not known_programs.is_known("e" * 64)


def test_the_list_does_not_grow_for_ever(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(known_programs, "_LARGEST", 650)
    for number in range(40):
        known_programs.remember(f"{number:064}")
    path = tmp_path / "stepbus" / "programs"
    assert path.stat().st_size <= 715
    assert known_programs.is_known(f"{39:064}")
    assert not known_programs.is_known(f"{0:064}")
    assert path.stat().st_mode & 0o777 == 0o600


def test_a_terminal_takes_no_orders_from_a_recording(stranger):
    programs = programs_of(Recording(stranger))
    spoof = type(programs)(
        fingerprint="",
        commands={"a": ("sh", "-c", "\x1b[2Jrm\r\n")},
        files=["x\x07.py"],
        is_known=False,
    )
    assert all(line.isprintable() for line in spoof.lines())


def test_a_package_of_a_recording_does_not_replace_an_installed_one(tmp_path):
    """`python -m` would search the folder of the recording first."""
    package = tmp_path / "source" / "stepbus_mission"
    package.mkdir(parents=True)
    spy = f"open({str(tmp_path / 'spied')!r}, 'w')\n"
    for name in ("__init__.py", "__main__.py", "params.py"):
        (package / name).write_text(spy)
    folder = package.parent
    for name in ("stepbus_schemas.py", "stepbus_participant.py", "zenoh.py"):
        (folder / name).write_text(spy)
    rows = "mission: {participant: stepbus_mission:Mission, params: {task: sine, joints: [a], amplitude: 1}, outputs: {reference: JointReference/1}}"
    (folder / "scenario.yaml").write_text(
        f"name: shadow\nstep: 5ms\nduration: 20ms\nparticipants:\n  {rows}\n"
    )
    out = tmp_path / "run"
    assert cli.main(["run", str(folder), "--no-report", "--out", str(out)]) == 0
    assert list(Recording(out / "run.mcap").attachments) == ["scenario.yaml"]
    assert cli.main(["rerun", str(out / "run.mcap"), "--out", str(tmp_path / "again")]) == 0
    assert not (tmp_path / "spied").exists()
