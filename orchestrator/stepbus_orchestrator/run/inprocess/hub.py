"""Turns of the participants that share a process: each works until it has to wait.

A participant waits in exactly one place, a queue of its bus. There it hands the thread back to the
hub, which gives it to the next one that has something to do. A turn costs under a microsecond,
where waking another thread or process costs ten and more.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from queue import Empty
from typing import Any

from greenlet import getcurrent, greenlet

from stepbus_participant import Clock

_IDLE_S = 0.01
"""How often a hub with nothing to do checks whether a signal has come [s]."""


class Late(BaseException):
    """Interrupts a participant that keeps the thread past its deadline."""


class Turn:
    """One participant's share of the thread. It starts at the root's next wait.

    A subclass says what it does until its end, and what is done around each turn.
    """

    def __init__(self, hub: Hub) -> None:
        self.deadline_s: float | None = None
        self.has_expired = False
        self.is_ready = False
        self.hub = hub
        self._greenlet = greenlet(self.work)
        hub.turns.append(self)
        hub.let_go_on(self)

    def work(self) -> None:
        """Take part, until the end."""
        raise NotImplementedError

    def enter(self) -> None:
        """Begin a turn."""

    def leave(self) -> None:
        """End a turn."""

    @property
    def is_running(self) -> bool:
        """Return whether its own code has the thread, not what gives it the thread."""
        return getcurrent() is self._greenlet

    @property
    def is_over(self) -> bool:
        """Return whether it has come to its end."""
        return bool(self._greenlet.dead)

    def take(self, *raised: BaseException) -> None:
        """Work until the next wait, or the end; raised: by its wait, to end it."""
        hub = self.hub
        hub.current = self
        self.is_ready, self.deadline_s = False, None
        self.enter()
        try:
            if raised:
                self._greenlet.throw(*raised)
            else:
                self._greenlet.switch()
        finally:
            self.leave()
            hub.current = None


class Hub:
    """Gives the thread to one participant after the other, in the order in which they can go on.

    current: whose turn it is. before: is called before participants get their turns. away: is
    called where no participant can go on; returns whether one can then.
    Its creator is the root: it gets the thread back where no participant can go on, and when its
    own queue has something.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.current: Turn | None = None
        self.before: Callable[[], None] = lambda: None
        self.away: Callable[[], bool] = lambda: False
        self.turns: list[Turn] = []
        self._ready: deque[Turn] = deque()
        self._root = getcurrent()

    def let_go_on(self, turn: Turn) -> None:
        """Give a participant its turn behind all that have one already."""
        if not turn.is_ready:
            turn.is_ready = True
            self._ready.append(turn)

    def queue(self) -> HubQueue:
        """Return a queue whose readers take turns."""
        return HubQueue(self)

    def end(self, turn: Turn, raised: BaseException) -> None:
        """End a participant that waits, by what its wait raises."""
        if turn in self._ready:
            self._ready.remove(turn)
        if not turn.is_over:
            self.before()
            turn.take(raised)

    def wait(self, turn: Turn, timeout_s: float | None) -> None:
        """Wait in the turn of a participant; its queue, or the time-out, ends that."""
        if timeout_s is not None:
            turn.deadline_s = self.clock.monotonic() + timeout_s
        self._root.switch()

    def rest(self, timeout_s: float | None, has_come: Callable[[], bool]) -> None:
        """Run every ready participant until something has come for the root or the time is over."""
        monotonic, ready = self.clock.monotonic, self._ready
        until_s = float("inf") if timeout_s is None else monotonic() + timeout_s
        while True:
            self.before()
            while ready:
                ready.popleft().take()
            if has_come():
                return
            if self.away() or self._expire():
                continue
            now = monotonic()
            if now >= until_s:
                return
            self.clock.sleep(min(_IDLE_S, until_s - now))

    def _expire(self) -> bool:
        """Wake those whose time-out is over; return whether there are any.

        Where no participant can go on, nothing more comes in time: the first time-out after a
        message is over at once. Later ones take their time, lest two that wait for each other spin.
        """
        now = self.clock.monotonic()
        for turn in self.turns:
            if turn.deadline_s is None:
                continue
            if not turn.has_expired or now >= turn.deadline_s:
                turn.has_expired = True
                self.let_go_on(turn)
        self.turns = [turn for turn in self.turns if not turn.is_over]
        return bool(self._ready)


class HubQueue:
    """A queue, as `queue.SimpleQueue`; waiting for it gives the others their turns."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._items: deque[Any] = deque()
        self._reader: Turn | None = None

    def put(self, item: Any) -> None:
        """Add an item, and let its reader go on."""
        self._items.append(item)
        reader = self._reader
        if reader is not None:
            self._reader = None
            reader.has_expired = False
            self._hub.let_go_on(reader)

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Return the oldest item; raises Empty after the time-out [s]."""
        if not self._items:
            if block:
                self._wait(timeout)
            if not self._items:
                raise Empty
        return self._items.popleft()

    def _wait(self, timeout_s: float | None) -> None:
        reader = self._reader = self._hub.current
        if reader is None:
            self._hub.rest(timeout_s, lambda: bool(self._items))
            return
        try:
            self._hub.wait(reader, timeout_s)
        finally:
            self._reader = None

    def empty(self) -> bool:
        """Return whether there is no item."""
        return not self._items

    def qsize(self) -> int:
        """Return how many items there are."""
        return len(self._items)
