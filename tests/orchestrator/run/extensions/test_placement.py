"""Participants that wait for each other share a core while that is faster."""

import os
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from stepbus_orchestrator.processes.child import Child
from stepbus_orchestrator.processes.place import Place
from stepbus_orchestrator.run.extensions.placement import Placement, in_cycles
from stepbus_orchestrator.scenario.load import load


class Machine:
    """A run on a machine on which each step takes a time that depends on where its chain is."""

    def __init__(self, apart, together, cores=2):
        self.rates = {True: together, False: apart}
        self.cores = cores
        self.now = 0.0
        self.is_timed = False
        self.kept = {"plant": None, "controller": None}
        self.done = 0.0
        self.placement = Placement()
        self.placement.attach(self)
        for name in self.kept:
            self.placement.started(SimpleNamespace(name=name, process=Core(self, name)))

    # What `Placement` sees of a run.
    @property
    def session(self):
        return SimpleNamespace(scenario=load("two_link"))

    @property
    def clock(self):
        return SimpleNamespace(monotonic=lambda: self.now)

    @property
    def state(self):
        return SimpleNamespace(phase=SimpleNamespace(is_stepping=True), barrier=self)

    @property
    def completed(self):
        return int(self.done)

    @property
    def is_together(self):
        return set(self.kept.values()) == {1}

    def run_for(self, duration_s):
        together_s = 0.0
        for _ in range(round(duration_s / 0.01)):
            self.placement.turn()
            self.done += 0.01 * self.rates[self.is_together]
            together_s += 0.01 * self.is_together
            self.now += 0.01
        return together_s / duration_s


class Core:
    def __init__(self, machine, name):
        self.machine, self.name = machine, name

    def core(self):
        return 1 if self.machine.cores > 1 else None

    def place(self, place):
        self.machine.kept[self.name] = place.core


def test_a_chain_that_is_faster_on_one_core_stays_there():
    assert Machine(apart=3000, together=4500).run_for(20) > 0.95


def test_one_that_is_slower_there_is_let_go():
    assert 0 < Machine(apart=3000, together=2900).run_for(20) < 0.05


def test_what_is_faster_is_tried_again_and_again():
    machine = Machine(apart=3000, together=4500)
    assert machine.run_for(10) > 0.9
    machine.rates[True] = 1000
    machine.run_for(10)
    assert machine.run_for(10) < 0.05


@pytest.mark.parametrize(
    "options", [{"apart": 80, "together": 200}, {"apart": 3000, "together": 4500, "cores": 1}]
)
def test_slow_steps_and_a_single_core_are_left_alone(options):
    assert Machine(**options).run_for(20) == 0


def test_only_those_that_wait_for_themselves_take_turns():
    assert in_cycles(load("two_link")) == ["plant", "controller"]


@pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2, reason="takes two cores of Linux"
)
def test_a_process_is_kept_with_all_its_threads(tmp_path):
    child = start(
        tmp_path,
        "import threading; threading.Thread(target=threading.Event().wait, daemon=True).start()",
    )
    try:
        assert child.core() in os.sched_getaffinity(0)
        child.place(Place(core=child.core(), yields=True))
        (kept,) = {frozenset(os.sched_getaffinity(thread)) for thread in threads(child)}
        assert len(kept) == 1
        assert child.core() is None  # it is on one core already, for whatever reason
        assert {os.sched_getscheduler(thread) for thread in threads(child)} == {os.SCHED_BATCH}
        child.place(Place())
        assert {frozenset(os.sched_getaffinity(thread)) for thread in threads(child)} == {
            frozenset(os.sched_getaffinity(0))
        }
        assert {os.sched_getscheduler(thread) for thread in threads(child)} == {os.SCHED_OTHER}
        (chosen, *_) = threads(child)
        os.sched_setscheduler(chosen, os.SCHED_IDLE, os.sched_param(0))
        assert child.core() is None
        child.place(Place(yields=True))
        assert os.sched_getscheduler(chosen) == os.SCHED_IDLE
    finally:
        child.end(0.0)
    child.place(Place())
    assert child.core() is None


def start(folder, code):
    program = f"{code}\nprint('up', flush=True)\nimport time\ntime.sleep(600)"
    log = folder / "child.log"
    child = Child(
        "plant", [sys.executable, "-c", program], cwd=folder, log=log, environment=dict(os.environ)
    )
    while "up" not in log.read_text():
        assert child.exit_code() is None
    return child


def threads(child):
    return [int(thread.name) for thread in Path(f"/proc/{child.pid}/task").iterdir()]
