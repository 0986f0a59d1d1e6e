"""Exports and views whose disk is full, whose recording is no good, or that are interrupted."""

import contextlib
import io
import resource
import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest
from support.messages.recordings import write

import stepbus
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.cli.scenarios.viewer import _pass_on, viewed
from stepbus_orchestrator.viewing.exports import tables
from stepbus_schemas import JointState

TARGETS = {
    "csv": "all.csv", "parquet": "all.parquet", "ros2": "a.mcap", "foxglove": "b.mcap",
    "scene": "c.html", "video": "d.gif",
}  # fmt: skip


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    out = tmp_path_factory.mktemp("endings") / "run"
    return stepbus.run("two_link", set={"duration": "1s"}, out=out, in_process=True).recording


@contextlib.contextmanager
def files_of_at_most(size):
    """Let no file of this process grow further, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("form", TARGETS)
def test_a_disk_that_is_full_is_one_sentence_and_leaves_no_file(
    recording, tmp_path, capsys, monkeypatch, form
):
    monkeypatch.setattr(tables, "_GROUP_ROWS", 100)
    # What is imported now would be cached in part.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    with files_of_at_most(4096):
        code = main(["export", str(recording), f"--{form}", str(tmp_path / TARGETS[form])])
    assert code == 8
    error = capsys.readouterr().err
    assert error.splitlines()[-1].startswith(f"stepbus: {tmp_path / TARGETS[form]} cannot be")
    assert "Traceback" not in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("end", ["png", "svg", "pdf"])
def test_a_picture_that_does_not_fit_on_the_disk_is_one_sentence(
    recording, tmp_path, capsys, monkeypatch, end
):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    target = tmp_path / f"plot.{end}"
    words = ["plot", str(recording), "plant.joint_state.position", "--out", str(target)]
    with files_of_at_most(4096):
        assert main(words) == 8
    assert capsys.readouterr().err == f"stepbus: {target} cannot be written: File too large\n"
    assert list(tmp_path.iterdir()) == []
    assert main(words) == 0
    assert target.stat().st_size > 4096


@pytest.mark.parametrize("words", [["report"], ["view", "--no-open"], ["view", "--foxglove"]])
def test_a_recording_of_another_system_has_no_page(recording, tmp_path, capsys, words):
    foreign = tmp_path / "ros2.mcap"
    assert main(["export", str(recording), "--ros2", str(foreign)]) == 0
    capsys.readouterr()
    assert main([words[0], str(foreign), *words[1:]]) == 8
    said = capsys.readouterr()
    assert "has no message that can be shown: it is not of stepbus, or of a newer" in said.err
    assert said.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["ros2.mcap"]


def test_the_report_of_half_a_recording_says_so(recording, tmp_path, capsys):
    half, data = tmp_path / "half.mcap", recording.read_bytes()
    half.write_bytes(data[: len(data) * 3 // 4])
    assert main(["report", str(half)]) == 0
    said = capsys.readouterr()
    assert "the recording is damaged after step" in said.err
    assert (tmp_path / "report.html").exists()
    empty = write(tmp_path / "empty.mcap", joint_state=("JointState/1", ["hip"], []))
    assert main(["report", str(empty), "--out", str(tmp_path / "empty.html")]) == 8
    assert "has no message that can be shown" in capsys.readouterr().err
    one = write(tmp_path / "one.mcap", a=("JointState/1", ["hip"], [JointState(position=[0.0])]))
    assert main(["report", str(one), "--out", str(tmp_path / "one.html")]) == 0
    assert capsys.readouterr().err == ""


_PROGRAM = """
import stepbus_orchestrator.cli.commands as commands
from stepbus_orchestrator.cli.entry import main

class Field:
    def __set_name__(self, owner, name):
        raise KeyboardInterrupt

def execute(_):
    type("Owner", (), {"field": Field()})

commands.execute = execute
raise SystemExit(main())
"""


def test_a_signal_while_a_class_is_made_is_no_error():
    command = [sys.executable, "-c", _PROGRAM]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "stepbus: interrupted\n")


def test_a_view_that_stays_ends_with_a_signal_to_the_run_alone(tmp_path, capsys):
    interrupt = threading.Event()
    with viewed(tmp_path / "run", [["--foxglove"]], stays=True, interrupt=interrupt):
        interrupt.set()
    assert "the view stays open until Ctrl-C" in capsys.readouterr().err


def test_what_a_view_complains_of_is_passed_on_but_not_its_end(capsys):
    _pass_on(SimpleNamespace(stderr=io.BytesIO(b"stepbus: it is lost\nstepbus: interrupted\n")))
    assert capsys.readouterr().err == "stepbus: it is lost\n"
