"""A participant that is forked from a warm parent is what one of its own start would be."""

import contextlib
import json
import signal
import subprocess
import sys

import psutil
import pytest
from support.runs.joints import leftovers, run_joints, write_scenario
from support.surroundings import comes_true, has_ended, living_children, warm_ones

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.processes import child, warm
from stepbus_orchestrator.run.extension import RunExtension

STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]
FACTS = """
import gc, json, os, random, resource, signal, socket, sys, threading
from pathlib import Path
from joints import Mission

def lines(name):
    return Path("/proc/self", name).read_bytes().rstrip(b"\\0").decode().split("\\0")

SAME = {
    "words": lines("cmdline"), "argv": sys.argv[1:], "orig_argv": sys.orig_argv[1:],
    "environment": sorted(os.environ.items()), "shown": sorted(lines("environ")),
    "folder": os.getcwd(), "path": sys.path, "hash": hash("stepbus"), "flags": repr(sys.flags),
    "leads": os.getpid() == os.getsid(0) == os.getpgrp(),
    "name": Path("/proc/self/comm").read_text(), "umask": os.umask(0o22),
    "threads": [one.name for one in threading.enumerate()],
    "streams": [os.readlink(f"/proc/self/fd/{n}") for n in range(3)],
    "inherits": [n for n in range(3, 256) if os.path.exists(f"/proc/self/fd/{n}")],
    "signals": {int(n): repr(signal.getsignal(n)) for n in signal.valid_signals() if n != 9},
    "masked": sorted(signal.pthread_sigmask(signal.SIG_BLOCK, [])),
    "limits": [resource.getrlimit(n) for n in range(16)], "cores": sorted(os.sched_getaffinity(0)),
    "oom": Path("/proc/self/oom_score_adj").read_text(), "module": __name__,
    "main": sys.modules["__main__"].__spec__.name, "gc": gc.get_threshold(),
}

class Facts(Mission):
    def __init__(self, config):
        super().__init__(config)
        import numpy
        own = {"parent": os.getppid(), "gc": gc.isenabled(), "frozen": gc.get_freeze_count() > 0}
        own["random"] = [random.random(), numpy.random.random()]
        print(json.dumps([SAME, own]))
"""
LEAVER = """
import os, time
from joints import Mission

class Leaver(Mission):
    def __init__(self, config):
        super().__init__(config)
        if os.fork() == 0:
            os.setsid()
            if os.fork() == 0:
                time.sleep(1000)
            os._exit(0)
        os.wait()
"""


def run_class(folder, name, program):
    """Run joints with a class of a file as mission, and return the result."""
    source = write_scenario(folder / "source").parent
    (source / f"{name.lower()}.py").write_text(program)
    return run_joints(folder, f"mission.participant={name.lower()}.py:{name}", "duration=20ms")


@pytest.fixture
def forked(monkeypatch):
    """Return the words of each participant that a warm parent forks."""
    words = []

    def fork(command, *place):
        made = warm.fork(command, *place)
        if made is not None:
            words.append(command[-1])
        return made

    monkeypatch.setattr(child, "fork", fork)
    return words


def facts_of(folder):
    result = run_class(folder, "Facts", FACTS)
    assert result.exit_code == 0, result.reason
    said = (folder / "out" / "logs" / "mission.log").read_text()
    # The folder of the run, and its private one, differ.
    _, _, ticket = said.partition("STEPBUS_TICKET=")
    private = ticket.partition("/mission.ticket")[0]
    same, own = json.loads(said.replace(private, "PRIVATE").replace(str(folder), "FOLDER"))
    return same, own


def test_a_forked_participant_finds_what_a_started_one_does(tmp_path, forked, monkeypatch):
    as_forked, own = facts_of(tmp_path / "forked")
    assert sorted(forked) == ["facts.py:Facts", "joints.py:Controller", "joints.py:Plant"]
    monkeypatch.setattr(child, "fork", lambda *_place: None)
    as_started, other = facts_of(tmp_path / "started")
    assert as_forked == as_started
    assert own | {"random": None} == other | {"random": None}


def test_what_is_random_differs_from_one_participant_to_the_next(tmp_path, forked):
    drawn = [facts_of(tmp_path / name)[1]["random"] for name in ("one", "other")]
    assert len(forked) == 6
    assert len({value for values in drawn for value in values}) == 4


def test_a_process_without_a_program_of_its_own_is_known_to_be_left_behind(
    tmp_path, forked, monkeypatch
):
    # A name that ends with the ticket's.
    monkeypatch.setenv("A_STEPBUS_TICKET", "no ticket")
    result = run_class(tmp_path, "Leaver", LEAVER)
    assert (result.exit_code, "leaver.py:Leaver" in forked) == (0, True)
    assert [warned.source for warned in result.warnings] == ["mission"]
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize(
    ("number", "code", "reason"),
    [(signal.SIGSTOP, ExitCode.START, "is it stopped?"), (signal.SIGKILL, 0, "finished")],
)
def test_without_its_warm_parent_a_run_goes_on_or_ends_in_a_sentence(
    tmp_path, forked, monkeypatch, number, code, reason
):
    monkeypatch.setattr(warm, "_ANSWER_S", 0.2)
    before = living_children()
    with warm.warm_parent():
        # Between fork and exec it still has our command line.
        assert comes_true(lambda: warm_ones(living_children() - before))
        (parent,) = warm_ones(living_children() - before)
        parent.send_signal(number)
        result = run_joints(tmp_path, "duration=50ms")
    assert (result.exit_code, forked, leftovers(tmp_path)) == (code, [], [])
    assert reason in result.reason
    assert has_ended(parent)


def test_one_run_has_its_warm_parent_until_all_have_started(tmp_path, forked):
    seen = []

    class Looks(RunExtension):
        def ready(self):
            seen.append(warm_ones(living_children() - before))

    before = living_children()
    result = run_joints(tmp_path, "duration=50ms", extensions=[Looks()])
    assert (result.exit_code, len(forked), seen) == (0, 3, [[]])


def test_a_warm_parent_ends_with_its_command(tmp_path):
    (tmp_path / "slow.py").write_text("import time; time.sleep(1000)")
    words = ["run", "two_link", "--with", "slow.py:Extension", "--out", "run"]
    with subprocess.Popen(
        [*STEPBUS, *words], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        command = psutil.Process(process.pid)
        try:
            assert comes_true(command.children)
            (parent,) = command.children()
            # It has told the kernel before it loads this.
            assert comes_true(lambda: any("numpy" in row.path for row in parent.memory_maps()))
            parent.suspend()
        finally:
            process.kill()
    try:
        assert comes_true(lambda: has_ended(parent))
    finally:
        # Where init reaps, it is gone.
        with contextlib.suppress(psutil.NoSuchProcess):
            parent.kill()
