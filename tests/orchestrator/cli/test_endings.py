"""How a command ends, whatever becomes of its output and whenever a signal comes."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from support.runs.joints import run_joints, write_scenario

from stepbus_orchestrator.cli.terminal.stdout_buffer import StdoutBuffer
from stepbus_orchestrator.errors import ExitCode

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]


@pytest.fixture
def run_words(tmp_path):
    """Return the command line of a short run."""
    path = write_scenario(tmp_path / "source")
    return [*STEPBUS, "run", str(path), "--in-process", "--out", str(tmp_path / "out")]


def result_of(tmp_path):
    return json.loads((tmp_path / "out" / "result.json").read_text())


def ended(command, stdout, **options):
    """Return exit code and stderr of a command whose stdout is a descriptor."""
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, stdout=stdout, stderr=subprocess.PIPE, text=True,
        check=False, timeout=60, **options,
    )  # fmt: skip
    return done.returncode, done.stderr


@contextlib.contextmanager
def closed_pipe():
    read, write = os.pipe()
    os.close(read)
    yield write
    os.close(write)


@contextlib.contextmanager
def unread(pair):
    """Yield a pipe or terminal that is full and that nobody reads."""
    read, write = pair()
    os.set_blocking(write, False)
    # The kernel moves what a terminal was given from one buffer to the next a moment later, and
    # has room again: it is full once it takes nothing for a while.
    refused = 0
    while refused < 3:
        try:
            os.write(write, bytes(1024))
            refused = 0
        except BlockingIOError:
            refused += 1
            time.sleep(0.2)
    os.set_blocking(write, True)
    yield write
    os.close(write)
    os.close(read)


def test_a_failed_run_keeps_its_code_though_its_reader_has_gone(run_words):
    words = [*run_words, "--no-report", "--json", "--fault", "reorder mission at 48"]
    with closed_pipe() as pipe:
        assert ended(words, pipe)[0] == ExitCode.FAULT


def test_a_difference_keeps_its_code_though_its_reader_has_gone(tmp_path):
    names = ("100ms", "200ms")
    first, second = (
        run_joints(tmp_path / name, f"duration={name}", in_process=True) for name in names
    )
    words = [*STEPBUS, "diff", first.recording, second.recording]
    with closed_pipe() as pipe:
        assert ended(words, pipe) == (ExitCode.DIFFERENT, "")


def test_a_run_whose_output_cannot_be_written_keeps_its_code_and_says_so(tmp_path, run_words):
    with Path("/dev/full").open("wb") as full:
        code, errors = ended([*run_words, "--no-report"], full)
    sentence = "stepbus: stdout: No space left on device; the output is incomplete\n"
    assert (code, errors, result_of(tmp_path)["exit_code"]) == (0, sentence, 0)


@pytest.mark.parametrize("word", ["--version", "--help", "types"])
def test_what_is_only_there_to_be_read_fails_where_it_cannot_be_written(word):
    with Path("/dev/full").open("wb") as full:
        code, errors = ended([*STEPBUS, word], full)
    sentence = "stepbus: stdout: No space left on device; the output is incomplete\n"
    assert (code, errors) == (ExitCode.INTERNAL, sentence)
    with closed_pipe() as pipe:
        assert ended([*STEPBUS, word], pipe) == (ExitCode.FINISHED, "")


@pytest.mark.parametrize("pair", [os.pipe, pytest.param(os.openpty, marks=pytest.mark.slow)])
def test_a_run_whose_output_nobody_reads_ends_by_itself(tmp_path, run_words, pair):
    with unread(pair) as stream:
        code, errors = ended([*run_words, "--no-report"], stream)
    sentence = "stepbus: stdout: no process reads it; the output is incomplete\n"
    assert (code, errors, result_of(tmp_path)["exit_code"]) == (0, sentence, 0)


def held_at_import(tmp_path, words, module):
    """Start a command and return its process once it imports a module, which takes for ever."""
    folder, mark = tmp_path / "slow", tmp_path / "importing"
    folder.mkdir()
    (folder / f"{module}.py").write_text(
        f"import pathlib, time\npathlib.Path({str(mark)!r}).touch()\ntime.sleep(60)\n"
    )
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(folder)},
    )  # fmt: skip
    give_up = time.monotonic() + 60
    while not mark.exists() and time.monotonic() < give_up and process.poll() is None:
        time.sleep(0.02)
    return process


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_while_the_command_loads_is_one_sentence(tmp_path, number):
    process = held_at_import(tmp_path, [*STEPBUS, "diff", "a", "b"], "numpy")
    process.send_signal(number)
    output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (130, "", "stepbus: interrupted\n")


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_during_the_report_leaves_a_run_that_has_finished(tmp_path, run_words, number):
    process = held_at_import(tmp_path, run_words, "matplotlib")
    process.send_signal(number)
    output, errors = process.communicate(timeout=30)
    assert (process.returncode, errors, result_of(tmp_path)["exit_code"]) == (0, "", 0)
    assert "no plots  the report was interrupted" in output
    assert "joints: finished after 100 steps" in output


ON_TERMINAL = """
import fcntl, os, sys, termios
os.setsid()
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""


def test_a_terminal_that_is_closed_ends_the_run_cleanly(tmp_path, run_words):
    master, slave = os.openpty()
    run_words.remove("--in-process")
    words = [sys.executable, "-c", ON_TERMINAL, *run_words, "--set", "duration=1000s"]
    process = subprocess.Popen(words, stdin=slave, stdout=slave, stderr=slave)
    os.close(slave)
    recording = tmp_path / "out" / "run.mcap"
    os.set_blocking(master, False)
    give_up = time.monotonic() + 60
    while time.monotonic() < give_up and process.poll() is None:
        with contextlib.suppress(BlockingIOError):
            os.read(master, 65536)
        if recording.exists() and recording.stat().st_size > 20_000:
            break
        time.sleep(0.02)
    os.close(master)
    assert process.wait(30) == ExitCode.INTERRUPTED
    assert result_of(tmp_path)["exit_code"] == ExitCode.INTERRUPTED


def test_what_runs_nothing_waits_for_its_reader_as_long_as_it_takes():
    read, write = os.pipe()
    buffer = StdoutBuffer(write)
    writer = threading.Thread(target=buffer.write, args=(bytes(200_000),))
    writer.start()
    writer.join(1.5)
    with os.fdopen(read, "rb") as stream:
        content = stream.read(200_000)
    writer.join(30)
    assert (len(content), buffer.backlog, buffer.failure) == (200_000, b"", "")
    buffer.close()
    os.close(write)
