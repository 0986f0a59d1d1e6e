"""What a test leaves of what it shares with others: only what is new since it began counts.

Other tests of the same worker, and libraries that are imported for the first time meanwhile, have
threads, children and handlers of their own. So nothing is counted: each thing is known by its
identity, and what is new gets time to end.
"""

import contextlib
import os
import signal
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest

PATIENCE_S = 60.0
"""How long what is ending may take: far longer than it does on a busy machine."""
WATCHED_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGURG)


def comes_true(condition, seconds=PATIENCE_S):
    """Return whether a condition comes true in time."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def answers(processes, question):
    """Return a question's answers by process, without those that have ended before they could answer."""
    given = {}
    for one in processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            given[one] = question(one)
    return given


def warm_ones(processes):
    """Return those processes from which participants are forked, until all have started."""
    words = answers(processes, psutil.Process.cmdline)
    return [one for one, said in words.items() if any("--warm" in word for word in said)]


def listening(processes):
    """Return the addresses that processes listen on, as `ss -ltn` shows them."""
    sockets = answers(processes, lambda one: one.net_connections("inet"))
    return {
        found.laddr.ip.removeprefix("::ffff:")
        for one in sockets.values()
        for found in one
        if found.status == psutil.CONN_LISTEN
    }


def has_ended(process):
    """Return whether a process of psutil runs no more; nobody may ever fetch its exit code."""
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def living_children():
    """Return all processes below this one that run."""
    return {c for c in psutil.Process().children(recursive=True) if not has_ended(c)}


def processes_in(*folders):
    """Return the command lines of all processes that work below the folders."""
    found = []
    for process in psutil.process_iter():
        try:
            below = any(Path(process.cwd()).is_relative_to(folder) for folder in folders)
            if below and not has_ended(process):
                found.append(" ".join(process.cmdline()))
        except (psutil.NoSuchProcess, psutil.AccessDenied):
            continue
    return found


def descriptors():
    """Return the open files of this process: number → what it is."""
    found = {}
    for entry in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):  # It is the one that lists them, or was closed.
            found[int(entry.name)] = str(entry.readlink())
    return found


@contextlib.contextmanager
def no_borrowed_descriptors():
    """Fail where a block leaves a descriptor of a process, or another one of an open file.

    What other threads open meanwhile, such as the socket of a new link, is new itself.
    """
    before = descriptors()

    def left():
        new = dict(descriptors().items() - before.items())
        return [what for what in new.values() if what in before.values() or "pidfd" in what]

    yield
    assert comes_true(lambda: not left()), left()


class Surroundings:
    """What this process is like now. own: the folder below which everything is the test's."""

    def __init__(self, own):
        self.own = own
        self.children = living_children()
        self.path = list(sys.path)
        self.handlers = handlers()
        self.values = values()

    def check(self):
        """Fail where something is new or changed."""
        assert comes_true(lambda: not self.new_children()), self.new_children()
        assert values() == self.values
        # A library may add to the path when it is imported; nobody may take away.
        assert [entry for entry in sys.path if entry in self.path] == self.path
        assert not [entry for entry in sys.path if Path(entry).is_relative_to(self.own)]
        assert not [n for n, handler in handlers().items() if self.is_ours(n, handler)]

    def new_children(self):
        return living_children() - self.children

    def is_ours(self, number, handler):
        """Return whether a handler was changed, and not by a library for itself."""
        if handler == self.handlers[number]:
            return False
        return not callable(handler) or getattr(handler, "__module__", "").startswith("stepbus")


def handlers():
    return {number: signal.getsignal(number) for number in WATCHED_SIGNALS}


def values():
    """Return what a run replaces for a time, by name; compared as objects."""
    main = sys.modules["__main__"]
    return {
        "folder": Path.cwd(), "arguments": tuple(sys.argv), "stdout": id(sys.stdout),
        "main": id(main), "exit": id(os._exit),
    }  # fmt: skip


@pytest.fixture(autouse=True)
def no_thread_is_left():
    """Fail where the test leaves a thread, which would work on in the middle of others."""
    before = set(threading.enumerate())
    yield
    assert comes_true(lambda: set(threading.enumerate()) <= before), threading.enumerate()


@pytest.fixture
def nothing_is_left(tmp_path, own_temp):
    """Fail where the test leaves a process in its folder or a temporary file."""
    yield
    own = tmp_path, own_temp
    assert comes_true(lambda: not processes_in(*own)), processes_in(*own)
    assert comes_true(lambda: not list(own_temp.iterdir())), list(own_temp.iterdir())


@pytest.fixture
def left_as_found(tmp_path, nothing_is_left):
    """Fail as well where it leaves a child or a changed setting of this process."""
    before = Surroundings(tmp_path)
    yield
    before.check()
