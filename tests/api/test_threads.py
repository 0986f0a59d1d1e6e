"""Runs in several threads of one process: none disturbs another."""

import contextlib
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import stepbus
from stepbus import errors
from stepbus_orchestrator.run.inprocess.guard import guard, unguard

SHORT = {"duration": "200ms"}


def hashes(folder, **options):
    """Run two_link four times in two threads, in the working directory; return the hashes."""

    def run(number):
        return stepbus.run("two_link", set=SHORT, out=f"{number}", **options).sha256

    with ThreadPoolExecutor(2) as pool:
        found = set(pool.map(run, range(4)))
    assert {path.parent.name for path in folder.glob("*/result.json")} >= set("0123")
    return found


@pytest.fixture(autouse=True)
def in_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_runs_in_one_process_take_turns(tmp_path):
    before = Path.cwd(), sys.stdout, sys.stderr, list(sys.path)
    alone = stepbus.run("two_link", set=SHORT, out=tmp_path / "alone", in_process=True).sha256
    assert hashes(tmp_path, in_process=True) == {alone}
    assert (Path.cwd(), sys.stdout, sys.stderr, list(sys.path)) == before


@pytest.mark.slow
def test_runs_in_separate_processes_go_on_beside_each_other(tmp_path):
    alone = stepbus.run("two_link", set=SHORT, out=tmp_path / "alone").sha256
    assert hashes(tmp_path) == {alone}


def test_a_run_that_waits_for_another_one_can_be_interrupted(tmp_path):
    class Began(stepbus.Observer):
        def progress(self, progress):
            if progress.step > 0:
                has_begun.set()

    has_begun, first, second = threading.Event(), threading.Event(), threading.Event()

    def run(name, interrupt, **options):
        return stepbus.run(
            "two_link", out=tmp_path / name, in_process=True, interrupt=interrupt, **options
        )

    second.set()
    with ThreadPoolExecutor(2) as pool:
        long = pool.submit(
            run, "first", first, set={"duration": "10h"}, observer=Began(), real_time=1.0
        )
        try:
            assert has_begun.wait(60)
            with pytest.raises(errors.Interrupted, match="while the run of another thread"):
                pool.submit(run, "second", second).result(60)
        finally:
            first.set()
        assert long.result(60).exit_code == 130


class Guarded:
    name = "plant"

    def __init__(self):
        self.threads = []

    def before_program(self):
        raise AssertionError("it starts none")

    @contextlib.contextmanager
    def starting(self, thread):
        self.threads.append(thread)
        yield


def test_a_thread_belongs_to_the_participant_whose_code_starts_it():
    me, guarded = threading.get_ident(), Guarded()

    def owner():
        return guarded if threading.get_ident() == me else None

    def start(thread):
        thread.start()
        thread.join(60)

    own = threading.Thread(target=int)
    with ThreadPoolExecutor(1) as other:
        other.submit(int).result(60)
        guard(owner)
        try:
            start(own)
            other.submit(start, threading.Thread(target=int)).result(60)
        finally:
            unguard(owner)
    start(threading.Thread(target=int))
    assert guarded.threads == [own]
