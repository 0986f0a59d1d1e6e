"""Simulated time, and the processes that live in it.

Exactly one process runs at any moment, and no time passes while it does; time passes when all of
them wait. So a run depends on nothing but the tape of its faults, and takes as long as its code.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from queue import Empty
from typing import Any

from greenlet import getcurrent, greenlet

NS = 1_000_000_000
_READ_NS = 200
"""What reading a clock takes: code that only watches the time comes to an end, too."""
_MOST_EVENTS = 200_000


class Livelock(BaseException):
    """A simulated run has gone on for far more events, or real time, than any run needs."""


class Dead(BaseException):
    """Code of a process that has ended is unwound: whatever it waits for never comes."""


class World:
    """Simulated time and all that is due in it.

    now_ns: the time since its beginning. trace: what has happened, a line each, where it is kept.
    """

    def __init__(self, *, keeps_trace: bool = False) -> None:
        self.now_ns = 0
        self.wall_ns = 1_700_000_000 * NS
        self.trace: list[str] | None = [] if keeps_trace else None
        self.processes: list[Process] = []
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._count = 0
        self._hub = getcurrent()

    def note(self, text: str) -> None:
        """Add a line to the trace."""
        if self.trace is not None:
            self.trace.append(f"{self.now_ns / 1e6:.3f} ms  {text}")

    def after(self, delay_ns: int, act: Callable[[], None]) -> None:
        """Let something happen after a time; it happens after all that is due at that time."""
        self._count += 1
        heapq.heappush(self._events, (self.now_ns + max(0, delay_ns), self._count, act))

    def go(self, until: Callable[[], bool]) -> None:
        """Let time pass until a condition holds, or nothing more is due.

        Raises Livelock where that takes more events than any run needs.
        """
        for _ in range(_MOST_EVENTS):
            if until() or not self._events:
                return
            t_ns, _, act = heapq.heappop(self._events)
            self.now_ns = max(self.now_ns, t_ns)
            act()
        raise Livelock(f"{_MOST_EVENTS} events, and no end at {self.now_ns / NS:.3f} s")

    def current(self) -> Process:
        """Return the process that runs now."""
        running = getcurrent()
        for process in self.processes:
            if process.thread is running:
                return process
        raise AssertionError("no simulated process runs")

    def switch_to_hub(self) -> Any:
        """Give up the thread until something wakes the process that runs."""
        return self._hub.switch()


class Process:
    """A simulated process: one thread of code, which can be frozen and killed.

    work: what it does; its return value is its exit code. clock: the one that it sees. calls: how
    many of the simulated machine it has made. on_call: number of a call → what happens before it.
    """

    def __init__(self, world: World, name: str, work: Callable[[], int]) -> None:
        self.world = world
        self.name = name
        self.clock = SimulatedClock(self)
        self.thread = greenlet(self._work)
        self.exit_code: int | None = None
        self.ended_ns = 0
        self.is_frozen = False
        self._is_cut_off = False
        self.calls = 0
        self.on_call: dict[int, Callable[[], None]] = {}
        self.on_end: list[Callable[[], None]] = []
        self._program = work
        self._waits = 0
        self._held: list[Callable[[], None]] = []
        world.processes.append(self)

    @property
    def is_dead(self) -> bool:
        """Return whether it has ended."""
        return self.exit_code is not None

    def start(self, delay_ns: int = 0) -> None:
        """Let it begin after a time."""
        self.world.after(delay_ns, lambda: self.act(self._resume))

    def act(self, what: Callable[[], None]) -> None:
        """Do something in this process: at once, when it thaws, or never where it has ended."""
        if self.is_dead:
            return
        if self.is_frozen:
            self._held.append(what)
        else:
            what()

    def wait(self, timeout_ns: int | None) -> None:
        """Wait until `wake` or a time has passed; only its own code may call this."""
        self.check()
        if timeout_ns is not None:
            self.wake(timeout_ns)
        self.world.switch_to_hub()
        self.check()

    def check(self) -> None:
        """Raise Dead in its own code once it has ended."""
        if self.is_dead and getcurrent() is self.thread:
            raise Dead(self.name)

    def unwind(self) -> None:
        """Run what its code does at its end, without effect: it has ended."""
        if self.thread:
            self.thread.throw(Dead(self.name))

    def wake(self, delay_ns: int = 0) -> None:
        """Let it go on after a time, if it still waits then."""
        number = self._waits

        def resume() -> None:
            if self._waits == number:
                self._resume()

        self.world.after(delay_ns, lambda: self.act(resume))

    def call(self) -> None:
        """Count a call that its own code makes; it may be the last."""
        self.check()
        if getcurrent() is self.thread:
            self.calls += 1
            act = self.on_call.get(self.calls)
            if act is not None:
                act()

    def freeze(self) -> None:
        """Stop it, as SIGSTOP does."""
        self.is_frozen = True
        if getcurrent() is self.thread:
            self._is_cut_off = True
            self.world.switch_to_hub()
            self.check()

    def thaw(self) -> None:
        """Let it go on, as SIGCONT does.

        Where its own code was stopped between two calls, that goes on before or after what has
        arrived meanwhile, which other threads of a real process take.
        """
        self.is_frozen = False
        held, self._held = self._held, []
        if self._is_cut_off:
            held.insert(len(held) if self.calls % 2 else 0, self._resume)
            self._is_cut_off = False
        for what in held:
            self.act(what)

    def kill(self, code: int = -9) -> None:
        """End it where it stands; none of its code runs any more."""
        if self.is_dead:
            return
        self._end(code)
        if getcurrent() is self.thread:
            self.world.switch_to_hub()

    def _end(self, code: int) -> None:
        self.exit_code, self.ended_ns = code, self.world.now_ns
        self._held = []
        self.world.note(f"{self.name} has ended with {code}")
        for what in self.on_end:
            what()

    def _resume(self) -> None:
        self._waits += 1
        self.thread.switch()

    def _work(self) -> None:
        try:
            code = self._program()
        except Dead:
            return
        if not self.is_dead:
            self._end(code)


class SimulatedClock:
    """The module `time`, as one simulated process sees it."""

    def __init__(self, process: Process) -> None:
        self._process = process
        self._world = process.world

    def monotonic_ns(self) -> int:
        """Return the time since the world's beginning [ns]."""
        self._process.call()
        self._world.now_ns += _READ_NS
        return self._world.now_ns

    def monotonic(self) -> float:
        """Return the same [s]."""
        return self.monotonic_ns() / NS

    def time_ns(self) -> int:
        """Return the time of day, which may jump [ns]."""
        return self._world.wall_ns + self.monotonic_ns()

    def sleep(self, seconds: float, /) -> None:
        """Wait [s]."""
        until_ns = self._world.now_ns + int(seconds * NS)
        while self._world.now_ns < until_ns and not self._process.is_dead:
            self._process.wait(until_ns - self._world.now_ns)


class SimulatedQueue:
    """A queue, as `queue.SimpleQueue`, whose reader waits in simulated time."""

    def __init__(self, process: Process) -> None:
        self._process = process
        self._items: list[Any] = []
        self._is_awaited = False

    def put(self, item: Any) -> None:
        """Add an item, and wake its reader."""
        self._items.append(item)
        if self._is_awaited:
            self._is_awaited = False
            self._process.wake()

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Return the oldest item; raises Empty after the time-out [s]."""
        if not self._items and block:
            self._wait(timeout)
        if not self._items:
            raise Empty
        return self._items.pop(0)

    def _wait(self, timeout: float | None) -> None:
        world = self._process.world
        until_ns = None if timeout is None else world.now_ns + int(timeout * NS)
        while not self._items and not self._process.is_dead:
            left_ns = None if until_ns is None else until_ns - world.now_ns
            if left_ns is not None and left_ns <= 0:
                return
            self._is_awaited = True
            self._process.wait(left_ns)
            self._is_awaited = False

    def empty(self) -> bool:
        """Return whether there is no item."""
        return not self._items

    def qsize(self) -> int:
        """Return how many items there are."""
        return len(self._items)
