"""Exports and views whose disk is full, whose recording is no good, or that are interrupted."""

import contextlib
import json
import resource
import signal
import subprocess
import sys
import threading
from pathlib import Path

import psutil
import pytest
from support.messages.recordings import write
from support.surroundings import answers, comes_true

import stepbus
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.cli.viewer import viewed
from stepbus_schemas import JointState

TARGETS = {
    "csv": "all.csv", "parquet": "all.parquet", "ros2": "a.mcap",
    "scene": "c.html", "video": "d.gif",
}  # fmt: skip


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    out = tmp_path_factory.mktemp("endings") / "run"
    return stepbus.run("two_link", set={"duration": "1s"}, out=out, in_process=True).recording


FULL_DISK = """
import contextlib, io, json, resource, sys
from pathlib import Path
from stepbus_orchestrator.cli import main
from stepbus_tools.viewing.exports import tables

tables._GROUP_ROWS = 100
sys.dont_write_bytecode = True  # what is imported now would be cached in part
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
results = []
for words in json.loads(sys.argv[1]):
    with contextlib.redirect_stderr(io.StringIO()) as errors:
        code = main(words)
    results.append((code, errors.getvalue(), Path(words[-1]).exists()))
print(json.dumps(results))
"""


def on_a_full_disk(*commands):
    """Return code and errors of commands and whether their target is there; no file of theirs may
    grow over 4096 bytes. They run in a process of their own: the limit holds for all of it.
    """
    words = [sys.executable, "-c", FULL_DISK, json.dumps(commands)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_a_disk_that_is_full_is_one_sentence_and_leaves_no_file(recording, tmp_path):
    targets = {form: str(tmp_path / name) for form, name in TARGETS.items()}
    commands = [["export", str(recording), f"--{form}", path] for form, path in targets.items()]
    for target, (code, errors, is_there) in zip(
        targets.values(), on_a_full_disk(*commands), strict=True
    ):
        assert (code, is_there, "Traceback" in errors) == (8, False, False)
        assert errors.splitlines()[-1].startswith(f"stepbus: {target} cannot be")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_picture_that_does_not_fit_on_the_disk_is_one_sentence(recording, tmp_path):
    targets = [str(tmp_path / f"plot.{end}") for end in ("png", "svg", "pdf")]
    commands = [
        ["plot", str(recording), "plant.joint_state.position", "--out", target]
        for target in targets
    ]
    assert on_a_full_disk(*commands) == [
        [8, f"stepbus: {target} cannot be written: File too large\n", False] for target in targets
    ]
    assert list(tmp_path.iterdir()) == []
    for command, target in zip(commands, targets, strict=True):
        assert main(command) == 0
        assert Path(target).stat().st_size > 4096


def test_the_report_of_half_a_recording_says_so(recording, tmp_path, capsys):
    half, data = tmp_path / "half.mcap", recording.read_bytes()
    half.write_bytes(data[: len(data) * 3 // 4])
    assert main(["report", str(half)]) == 0
    said = capsys.readouterr()
    assert "the recording is damaged: " in said.err
    assert (tmp_path / "report.html").exists()
    empty = write(tmp_path / "empty.mcap", joint_state=("JointState/1", ["hip"], []))
    assert main(["report", str(empty), "--out", str(tmp_path / "empty.html")]) == 8
    assert "has no message that can be shown" in capsys.readouterr().err
    one = write(tmp_path / "one.mcap", a=("JointState/1", ["hip"], [JointState(position=[0.0])]))
    assert main(["report", str(one), "--out", str(tmp_path / "one.html")]) == 0
    assert capsys.readouterr().err == ""


_PROGRAM = """
import sys

import stepbus_orchestrator.cli.dispatch as module
from stepbus_orchestrator.cli.entry import main

class Field:
    def __set_name__(self, owner, name):
        raise KeyboardInterrupt

def execute(*_):
    type("Owner", (), {"field": Field()})

module.execute = execute
sys.argv[1:] = ["info"]
raise SystemExit(main())
"""


def test_a_signal_while_a_class_is_made_is_no_error():
    command = [sys.executable, "-c", _PROGRAM]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "stepbus: interrupted\n")


def test_a_view_that_stays_ends_with_a_signal_to_the_run_alone(tmp_path, capsys):
    interrupt = threading.Event()
    with viewed(tmp_path / "run", opens=False, stays=True, interrupt=interrupt):
        interrupt.set()
    assert "the view stays open until Ctrl-C" in capsys.readouterr().err


SILENT = [sys.executable, "-c", "import time; time.sleep(1000)"]
VIEWER = "stepbus_orchestrator.cli.viewer"


def test_a_view_that_does_not_begin_is_not_waited_for(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(f"{VIEWER}._COMMAND", SILENT)
    monkeypatch.setattr(f"{VIEWER}._START_S", 0.2)
    with viewed(tmp_path / "run", opens=False, stays=False, interrupt=threading.Event()):
        assert "not started after 0 s" in (capsys.readouterr().err)


def test_a_signal_ends_the_wait_for_a_view(tmp_path, monkeypatch):
    monkeypatch.setattr(f"{VIEWER}._COMMAND", SILENT)
    interrupt = threading.Event()
    threading.Timer(0.3, interrupt.set).start()
    with (
        pytest.raises(KeyboardInterrupt),
        viewed(tmp_path / "run", opens=False, stays=False, interrupt=interrupt),
    ):
        pytest.fail("nobody can see it")


@pytest.mark.slow
def test_a_view_that_is_stopped_at_its_start_delays_no_run_for_good(tmp_path):
    words = ["run", "two_link", "--set", "duration=50ms", "--no-report", "--view", "--no-open"]
    command = [sys.executable, "-m", "stepbus_orchestrator.cli", *words, "--out", tmp_path / "run"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as started:
        run = psutil.Process(started.pid)
        assert comes_true(lambda: stopped_views(run))
        assert comes_true((tmp_path / "run" / "result.json").exists, 90)
        # It ends by itself or, where its view has come after all, by Ctrl-C; not by one as it exits.
        with contextlib.suppress(subprocess.TimeoutExpired):
            started.wait(10)
        started.send_signal(signal.SIGINT)
        _, errors = started.communicate(timeout=30)
    assert "not started after 30 s" in errors
    assert json.loads((tmp_path / "run" / "result.json").read_text())["exit_code"] == 0
    assert started.returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("files", [8, 10])
def test_a_view_that_may_open_few_files_ends_with_a_sentence(recording, files):
    def limit():
        resource.setrlimit(resource.RLIMIT_NOFILE, (files, files))

    words = [sys.executable, "-m", "stepbus_orchestrator.cli", "view", recording, "--no-open"]
    done = subprocess.run(
        words,
        preexec_fn=limit,
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert done.returncode in {1, 2}
    assert "Too many open files" in done.stderr


def stopped_views(run):
    """Stop the views below a run from outside, and return them."""
    words = answers(run.children(), psutil.Process.cmdline)
    views = [child for child, said in words.items() if "view" in said]
    for view in views:
        view.suspend()
    return views
