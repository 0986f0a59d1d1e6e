"""Whatever a participant does to the process that it shares, the run ends, and names it."""

import json
import os
import signal
import subprocess
import sys
from typing import NamedTuple

import psutil
import pytest
from support.paths import PROGRAMS
from support.runs.joints import SCENARIO, write_scenario

STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]
MOMENTS = ("import", "start", "step", "close")
HANGS_S = 90.0
"""Far longer than any deadline of these runs: who needs it hangs."""


class Verdict(NamedTuple):
    """What a kind of misbehaviour ends with, by moment; short: which deadline is to expire."""

    codes: dict[str, int]
    short: dict[str, tuple[str, ...]]


BEFORE = ("spawn", "join", "ready")
LATE = Verdict(
    {"import": 3, "start": 3, "step": 6, "close": 9},
    {"import": BEFORE, "start": BEFORE, "step": ("step",), "close": ("stop",)},
)
LEFT = Verdict(dict.fromkeys(MOMENTS, 9), dict.fromkeys(MOMENTS, ("stop",)))
DIED = Verdict({"import": 3, "start": 3, "step": 5, "close": 5}, {})
# At the close, the recording is complete already.
INTERRUPTED = Verdict({**dict.fromkeys(MOMENTS, 130), "close": 0}, {})
HARMLESS = Verdict(dict.fromkeys(MOMENTS, 0), {})

KINDS = {
    "spin": LATE,
    "sleep": LATE,
    "sleep_with_lock": LATE,
    "hang_with_lock": LATE,
    "hang_in_c": LATE,
    "catch_everything": LATE,
    "ignore_signals_and_sleep": LATE,
    "lock_from_thread": LATE,
    "stop_in_c": LATE,
    "leave_thread": LEFT,
    "leave_pool": LEFT,
    "leave_exit": LEFT,
    "leave_exit_with_lock": LEFT,
    "kill_self": DIED,
    "kill_group": INTERRUPTED,
    "raise_kill": DIED,
    "crash": DIED,
    "abort": DIED,
    "leave_process": DIED,
    "leave_process_in_c": DIED,
    "stop_self": LATE,
    "fork": HARMLESS,
    "fork_terminal": HARMLESS,
    "fork_twice": HARMLESS,
    "fork_in_c": HARMLESS,
    "ignore_signals": HARMLESS,
    "leave_daemon": HARMLESS,
    "leave_child": HARMLESS,
    "leave_grandchild": HARMLESS,
    "close_standard_streams": HARMLESS,
}
EVERY = (*BEFORE, "step", "stop")
ALWAYS = {
    ("hang_with_lock", "step"),
    ("fork_twice", "step"),
    ("leave_child", "step"),
}
"""A handful for every run of the tests; all of them take some minutes."""
CASES = [
    pytest.param(kind, moment, marks=() if (kind, moment) in ALWAYS else pytest.mark.slow)
    for kind in KINDS
    for moment in MOMENTS
]


class Done(NamedTuple):
    code: int
    errors: str
    result: dict
    left: list[str]


def write_misbehaving(source, kind, moment):
    """Write the scenario whose controller misbehaves; return its path."""
    text = SCENARIO.replace("500ms", "2s")
    path = write_scenario(source, text.replace("joints.py:Controller", "misbehaving.py:Controller"))
    program = (PROGRAMS / "misbehaving.py").read_text()
    assert 'KIND, MOMENT = "", ""' in program
    program = program.replace('KIND, MOMENT = "", ""', f"KIND, MOMENT = {kind!r}, {moment!r}")
    (source / "misbehaving.py").write_text(program)
    return path


def misbehave(folder, kind, moment, *options):
    """Run the scenario from outside, with a deadline of 1 s where that is to expire."""
    path = write_misbehaving(folder / "source", kind, moment)
    deadlines = KINDS[kind].short.get(moment, ()) if kind in KINDS else EVERY
    # Of all: the thread of one may keep the lock in the turn of another.
    names = ("controller",) if kind in KINDS else ("controller", "plant", "mission")
    short = [f"{name}.{d}_timeout=1s" for name in names for d in deadlines]
    words = [*STEPBUS, "run", str(path), "--no-report", "--out", str(folder / "out"), *options]
    words += [word for name in short for word in ("--set", name)]
    mark = {**os.environ, "STEPBUS_TEST": str(folder)}
    with (folder / "stderr").open("wb") as errors:
        process = subprocess.Popen(
            words, stdin=subprocess.DEVNULL, stdout=errors, stderr=errors, env=mark,
            start_new_session=True,
        )  # fmt: skip
    try:
        code = process.wait(HANGS_S)
    finally:
        left = end_all(folder)
        process.wait()
    result = folder / "out/result.json"
    content = json.loads(result.read_text()) if result.exists() else {}
    return Done(code, (folder / "stderr").read_text(), content, left)


def end_all(folder):
    """Kill what is left of a run, known by its environment; return the command lines."""
    left = []
    for process in psutil.process_iter():
        try:
            if process.environ().get("STEPBUS_TEST") == str(folder):
                left.append(" ".join(process.cmdline()))
                process.kill()
        except (psutil.NoSuchProcess, psutil.AccessDenied):
            continue
    return left


@pytest.mark.usefixtures("starts_a_process")
def test_a_program_with_a_session_of_its_own_keeps_running(tmp_path):
    done = misbehave(tmp_path, "leave_session", "step", "--in-process")
    assert (done.code, done.left) == (0, ["sleep 1000"]), done.errors


@pytest.mark.usefixtures("starts_a_process")
@pytest.mark.parametrize(("kind", "moment"), CASES)
def test_the_run_ends_with_the_right_word_and_leaves_nothing(tmp_path, kind, moment):
    done = misbehave(tmp_path, kind, moment, "--in-process")
    code = KINDS[kind].codes[moment]
    blamed = "controller" if code not in {0, 130} else None
    assert done.left == [], done.errors
    assert (done.code, done.result.get("exit_code")) == (code, code), done.errors
    assert done.result["participant"] == blamed or not code, done.errors
    if code:
        assert "stepbus: " in done.errors
    if blamed:
        assert "controller" in done.errors
    if moment == "step" and code not in {0, 9, 130}:
        assert "step 300 (t = 1.500 s): controller" in done.errors


@pytest.mark.slow
@pytest.mark.usefixtures("starts_a_process")
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_thread_that_keeps_the_lock_in_the_turn_of_another_is_its_participants(tmp_path, moment):
    done = misbehave(tmp_path, "lock_from_thread_later", moment, "--in-process")
    assert done.left == [], done.errors
    # Where the run is by then depends on the machine; the first turn after it may be anybody's.
    assert done.code in {3, 6, 9}, done.errors
    assert (done.result["exit_code"], done.result["participant"]) == (done.code, "controller")
    words = ["has a thread that held", "has been computing", "kept the process"]
    assert any(text in done.errors for text in words), done.errors


@pytest.mark.slow
@pytest.mark.usefixtures("starts_a_process")
@pytest.mark.parametrize("kind", ["leave_thread", "leave_exit", "leave_pool", "kill_self", "crash"])
def test_the_verdict_is_that_of_separate_processes(tmp_path, kind):
    verdicts = [
        (done.code, done.result["participant"])
        for options in ([], ["--in-process"])
        for done in [misbehave(tmp_path / str(len(options)), kind, "step", *options)]
    ]
    assert verdicts[0] == verdicts[1]


@pytest.mark.slow
@pytest.mark.usefixtures("starts_a_process")
def test_from_python_the_process_is_killed_with_a_result(tmp_path):
    path = write_misbehaving(tmp_path / "source", "hang_with_lock", "import")
    program = (
        "import stepbus, sys; "
        "stepbus.run(sys.argv[1], out=sys.argv[2], in_process=True, "
        "set={f'controller.{d}_timeout': '1s' for d in ('spawn', 'join', 'ready')})"
    )
    words = [sys.executable, "-c", program, path, tmp_path / "alone"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=HANGS_S, check=False)
    result = json.loads((tmp_path / "alone/result.json").read_text())
    assert done.returncode == -signal.SIGKILL
    assert (result["exit_code"], result["participant"]) == (3, "controller")
    assert "in hang_with_lock" in done.stderr


@pytest.mark.slow
@pytest.mark.usefixtures("starts_a_process")
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("raise_kill", "had its turn when SIGKILL killed the"),
        ("stop_in_c", "share was stopped by a signal or a"),
    ],
)
def test_a_signal_that_another_process_may_have_sent_is_not_said_to_be_a_participants(
    tmp_path, kind, words
):
    done = misbehave(tmp_path, kind, "step", "--in-process")
    assert words in done.errors
    assert words in done.result["reason"]
