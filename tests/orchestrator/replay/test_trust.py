"""The programs of a recording that was made elsewhere start only with `--trust`."""

import json
import os
import shutil
import subprocess
import sys

import pytest
from support.runs.joints import run_joints

from stepbus_orchestrator import cli
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import McapFile, Recording
from stepbus_orchestrator.replay import replay
from stepbus_orchestrator.replay.trust import programs_of

REPLAY = ("--participant", "controller", "--recorded")


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """Return a recording whose programs stand in the work tree, which is the current folder."""
    monkeypatch.chdir(tmp_path)
    return run_joints(tmp_path, "duration=50ms", in_process=True).recording


@pytest.fixture
def stranger(recorded, tmp_path):
    """Return the same recording where its programs stand nowhere: at another user's, say."""
    shutil.rmtree(tmp_path / "source")
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
    unstarted, tmp_path, capsys, words
):
    assert cli.main([words[0], str(unstarted), *words[1:]]) == ExitCode.UNTRUSTED == 12
    said = capsys.readouterr().err
    assert f"{unstarted} contains programs that are not those of your scenario." in said
    assert "\n  controller  joints.py:Controller\n" in said
    assert "\n  its files: joints.py\n" in said
    assert ("\n  mission" in said) == (words[0] == "rerun")
    assert said.endswith("nothing was started; if you trust these programs, use --trust\n")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("words", [("rerun", "--out", "again"), ("replay", *REPLAY)])
def test_with_trust_it_is_started_and_nothing_is_remembered(stranger, words):
    command, *options = words
    assert cli.main([command, str(stranger), *options, "--trust"]) == 0
    assert cli.main(["replay", str(stranger), *REPLAY]) == ExitCode.UNTRUSTED


@pytest.mark.parametrize("words", [("rerun",), ("branch", "--at", "5"), ("replay", *REPLAY)])
def test_a_file_that_was_edited_since_is_mentioned(recorded, tmp_path, capsys, words):
    program = tmp_path / "source" / "joints.py"
    program.write_text(program.read_text() + "# edited\n")
    said = "source/joints.py differs from the recording, whose own copy runs\n"
    for trust in ([], ["--trust"]):
        cli.main([words[0], str(recorded), *words[1:], *trust])
        assert said in capsys.readouterr().err


@pytest.mark.parametrize("command", [("rerun", "--out", "again"), ("replay", *REPLAY)])
def test_what_stands_in_the_work_tree_is_started_wherever_the_recording_lies(
    recorded, tmp_path, command, monkeypatch
):
    monkeypatch.chdir(tmp_path / "source")
    (tmp_path / "elsewhere").mkdir()
    moved = recorded.rename(tmp_path / "elsewhere" / "moved.mcap")
    assert cli.main([command[0], str(moved), *command[1:]]) == 0


@pytest.mark.parametrize("change", ["code", "program", "others may write", "owner"])
def test_what_differs_from_the_work_tree_is_asked_for(recorded, tmp_path, change):
    program, scenario = (tmp_path / "source" / name for name in ("joints.py", "scenario.yaml"))
    if change == "code":
        program.write_text(program.read_text() + "\n")
    elif change == "program":
        text = scenario.read_text()
        scenario.write_text(text.replace("joints.py:Controller", "joints.py:Plant"))
    elif change == "others may write":
        program.chmod(0o666)
    elif os.getuid() != 0:
        pytest.skip("only root can give a file to somebody else")
    else:
        os.chown(program, 12345, 12345)
    assert not programs_of(Recording(recorded)).is_yours
    assert cli.main(["replay", str(recorded), *REPLAY]) == ExitCode.UNTRUSTED


def test_installed_classes_need_no_trust(two_link_recording, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert programs_of(Recording(two_link_recording)).is_yours
    assert cli.main(["rerun", str(two_link_recording), "--out", "again"]) == 0


LAW = """
class Still:
    def __init__(self, robot, params): pass
    def torque(self, q, v, reference, dt): return 0 * q
"""


def test_a_law_in_a_file_is_code_of_the_recording_though_its_participant_is_installed(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    params = "{law: 'law:Still', kp: null, kd: null}"
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm/law.py").write_text(LAW)
    (tmp_path / "arm/scenario.yaml").write_text(
        f"extends: two_link/pd\nname: arm\nduration: 50ms\nparticipants: {{controller: {{params: {params}}}}}\n"
    )
    assert cli.main(["run", "arm", "--no-report", "--in-process", "--out", "run"]) == 0
    assert cli.main(["rerun", "run", "--out", "again"]) == 0
    (tmp_path / "arm/law.py").write_text(LAW + "# changed")
    capsys.readouterr()
    assert cli.main(["rerun", "run", "--out", "third"]) == ExitCode.UNTRUSTED
    assert "its files: law.py" in capsys.readouterr().err


def test_a_program_of_ones_own_needs_trust_only_where_it_could_run_a_file(stranger):
    with_code = programs_of(Recording(stranger), "controller", own_program=True)
    assert (with_code.commands, list(with_code.files)) == ({}, ["joints.py"])
    assert not with_code.is_yours


def test_a_program_of_ones_own_needs_no_trust_for_data(two_link_recording):
    program = ["--exec", sys.executable, "-m", "stepbus_participant"]
    program.append("stepbus_controller:Controller")
    assert cli.main(["replay", str(two_link_recording), *REPLAY, *program]) == 0


def test_from_python_who_names_a_recording_trusts_it(stranger):
    assert replay(stranger, "controller").equal


def test_a_terminal_takes_no_orders_from_a_recording(stranger):
    programs = programs_of(Recording(stranger))
    spoof = type(programs)(
        commands={"a": ("sh", "-c", "\x1b[2Jrm\r\n")},
        files=["x\x07.py"],
        is_yours=False,
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
    assert "files/stepbus_mission/params.py" in Recording(out / "run.mcap").attachments
    assert cli.main(["rerun", str(out / "run.mcap"), "--out", str(tmp_path / "again")]) == 0
    assert not (tmp_path / "spied").exists()


def made_elsewhere(path, participants, files=None, **keys):
    """Write a recording without messages; files: name → text."""
    file = McapFile(path)
    row = {"name": "s", "step": "5ms", "duration": "50ms", "participants": participants, **keys}
    file.attach("scenario.yaml", json.dumps(row).encode())
    for name, text in (files or {}).items():
        file.attach(f"files/{name}", text.encode())
    file.close()
    return path


@pytest.fixture
def spy(tmp_path, monkeypatch):
    """Install a module for another use, which leaves a file where it is imported."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site/spy.py").write_text(f"open({str(tmp_path / 'spied')!r}, 'w')\n")
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "spied"


LAW_OF_SPY = {"joints": ["a"], "law": "spy:Law"}


@pytest.mark.parametrize("words", [("rerun",), ("branch", "--at", "0"), ("replay", *REPLAY)])
@pytest.mark.parametrize(
    "row",
    [
        {"participant": "spy:Controller"},
        {"participant": "stepbus_controller:Controller", "params": LAW_OF_SPY},
        {"participant": "stepbus_mission:Mission", "params": {"task": "spy:Task"}},
        {"participant": "stepbus_coppelia:Gateway", "params": {"command": ["echo", "spy:"]}},
        {"participant": "stepbus_fmi:Fmu", "params": {"fmu": "/tmp/spy:.fmu"}},
    ],
)
def test_a_module_that_is_installed_for_another_use_is_not_imported(
    spy, tmp_path, capsys, words, row
):
    path = made_elsewhere(tmp_path / "run.mcap", {"controller": row})
    assert cli.main([words[0], str(path), *words[1:]]) == ExitCode.UNTRUSTED
    assert "spy:" in capsys.readouterr().err
    assert not spy.exists()


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"types": "evil"}, "its message types refer to the module 'evil': refused"),
        ({"types": ["types.yaml", "evil"]}, "its message types refer to the module 'evil'"),
        ({"extends": "base.yaml"}, "its scenario has the key 'extends': refused"),
    ],
)
def test_a_recording_whose_programs_come_from_elsewhere_is_refused(tmp_path, capsys, keys, why):
    base = json.dumps({"participants": {"controller": {"exec": ["sh", "-c", "exit 1"]}}})
    files = {"base.yaml": base}
    path = made_elsewhere(tmp_path / "run.mcap", {"controller": {}}, files, **keys)
    assert cli.main(["rerun", str(path)]) == ExitCode.RECORDING
    assert why in capsys.readouterr().err
