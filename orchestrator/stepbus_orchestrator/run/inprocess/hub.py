"""Participants that share this process: each works until it has to wait.

A participant waits in exactly one place, a queue of its bus. There it hands the thread back to the
hub, which gives it to the next one that has something to do. A turn costs under a microsecond,
where waking another thread or process costs ten and more.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable
from pathlib import Path
from queue import Empty
from typing import Any, TextIO

from greenlet import getcurrent, greenlet

from stepbus_orchestrator.processes.activity import NOTHING, Activity
from stepbus_orchestrator.processes.child import Process
from stepbus_orchestrator.run.inprocess.heartbeat import TURN, TURNS
from stepbus_participant import HOST, Bus, Clock, Host, Ticket, append_to

_IDLE_S = 0.01
"""How often a hub with nothing to do checks whether a signal has come [s]."""


class Late(BaseException):
    """Interrupts a participant that keeps the thread past its deadline."""


class Ended(BaseException):
    """Ends a participant whose process would get the signal `number`."""

    def __init__(self, number: int) -> None:
        super().__init__(f"ended by {signal.Signals(number).name}")
        self.number = number


class HostedParticipant(Process):
    """A participant that shares this process; it stands where its `Child` would.

    Its first turn comes at the root's next wait.

    log: where it prints, unless it is `shown`: then where we do. program: what it does, and returns
    an exit code. words, number: the memory of the outside watcher, and which it is there. pid: of
    this process. late: how it missed a deadline, once it has. greenlet: in which it works.
    """

    def __init__(
        self,
        hub: Hub,
        ticket: Ticket,
        bus: Bus,
        log: Path,
        program: Callable[[], int],
        *,
        words: memoryview[float],
        number: int,
        shown: bool,
    ) -> None:
        super().__init__(log)
        self.name = ticket.name
        self.pid = os.getpid()
        self.deadline_s: float | None = None
        self.has_expired = False
        self.is_ready = False
        self._hub = hub
        self._words = words
        self._number = number
        self._program = program
        self._host = Host(ticket, bus)
        self._code: int | None = None
        self._output: TextIO = (
            sys.stdout if shown else os.fdopen(append_to(self.log), "a", 1, "utf-8", "replace")
        )
        self.greenlet = greenlet(self._work)
        hub.hosted.append(self)
        hub.let_go_on(self)

    # --- its turns ------------------------------------------------------------------------

    @property
    def is_running(self) -> bool:
        """Return whether its own code has the thread, not what gives it the thread."""
        return getcurrent() is self.greenlet

    @property
    def is_over(self) -> bool:
        """Return whether it has come to its end."""
        return bool(self.greenlet.dead)

    def take_turn(self, *raised: BaseException) -> None:
        """Work until the next wait, or the end; raised: by its wait, to end it.

        Meanwhile, what is printed goes to its log.
        """
        streams = sys.stdout, sys.stderr
        self.begin()
        try:
            if raised:
                self.greenlet.throw(*raised)
            else:
                self.greenlet.switch()
        finally:
            # Perhaps another one than this has handed the thread back.
            self._words[TURN] = 0
            sys.stdout, sys.stderr = streams
            self._hub.current = None

    def begin(self) -> None:
        """Note whose turn it is from now on; `greenlet.switch()` makes it so."""
        words = self._words
        self._hub.current = self
        self.is_ready, self.deadline_s = False, None
        sys.stdout = sys.stderr = self._output
        words[TURN] = self._number
        words[TURNS] += 1

    def _work(self) -> None:
        """Run the program to its end, and keep its exit code as its process would."""
        HOST.set(self._host)
        code = -int(signal.SIGKILL)
        try:
            code = self._program()
        except SystemExit as exc:
            code = exc.code if isinstance(exc.code, int) else int(exc.code is not None)
            if code and code is not exc.code:
                self._print(f"{exc.code}\n")
        except Ended as exc:
            code = -exc.number
        except Late:
            self._print(traceback.format_exc())
        except BaseException:  # noqa: BLE001  (whatever ends a program ends its process only)
            self._print(traceback.format_exc())
            code = 1
        finally:
            self._give_up(code)

    def _print(self, text: str) -> None:
        # On a full disk its log lacks its last words.
        with contextlib.suppress(OSError):
            self._output.write(text)

    def _give_up(self, code: int) -> None:
        self._host.bus.close()
        self._code = code

    # --- its process ------------------------------------------------------------------------

    def exit_code(self) -> int | None:
        """Return its exit code, negative for a signal; None while it takes part."""
        return self._code

    def activity(self) -> Activity:
        """Return nothing: it is this process."""
        return NOTHING

    def signal(self, number: int) -> None:
        """End it by a signal that would end its process; others do nothing."""
        if number in {signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV} and self._code is None:
            try:
                self._hub.end(self, Ended(number))
            except Ended:
                # It had not started.
                self._give_up(-number)

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has ended within a time [s]."""
        self._hub.rest(timeout_s, lambda: self._code is not None)
        return self._code is not None

    def end(self, grace_s: float = 0.0) -> None:
        """End it, whatever it waits for."""
        self.signal(signal.SIGTERM)
        if self._code is None:
            # It has caught what should have ended it, and waits again. Nothing will wake it.
            self._give_up(-signal.SIGKILL)
        if self._output is not sys.stdout:
            with contextlib.suppress(OSError):
                self._output.close()


class Hub:
    """Gives the thread to one participant after the other, in the order in which they can go on.

    current: whose turn it is. hosted: all participants. before: is called before they get their
    turns. has_news: whether something has come that no participant waits for. root: its creator's
    greenlet.
    Its creator is the root: it gets the thread back where no participant can go on, and when its
    own queue has something.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.current: HostedParticipant | None = None
        self.before: Callable[[], None] = lambda: None
        self.hosted: list[HostedParticipant] = []
        self.has_news = False
        self._ready: deque[HostedParticipant] = deque()
        self.root = getcurrent()

    def let_go_on(self, hosted: HostedParticipant) -> None:
        """Give a participant its turn after all that have one already."""
        hosted.has_expired = False
        if not hosted.is_ready:
            hosted.is_ready = True
            self._ready.append(hosted)

    def give_turns(self) -> bool:
        """Give all others that can go on their turns, from one; return whether there were any."""
        me = self.current
        if me is None or not (self._ready or self.has_news):
            return False
        self.let_go_on(me)
        self.pause(None)
        return True

    def pause(self, timeout_s: float | None) -> bool:
        """Give the thread of a participant to the next one, or to the root if it has news.

        Return whether the participant gets it back because the time [s] is over.
        """
        me: Any = self.current
        if timeout_s is not None:
            # The first time-out counts at once, see `_expire`.
            me.deadline_s = self.clock.monotonic() + timeout_s if me.has_expired else 0.0
        if self._ready and not self.has_news:
            following = self._ready.popleft()
            following.begin()
            following.greenlet.switch()
        else:
            self.root.switch()
        return bool(me.has_expired)

    def queue(self) -> HubQueue:
        """Return a queue whose readers take turns."""
        return HubQueue(self)

    def end(self, hosted: HostedParticipant, raised: BaseException) -> None:
        """End a participant that waits, by what its wait raises."""
        if hosted in self._ready:
            self._ready.remove(hosted)
        if not hosted.is_over:
            self.before()
            hosted.take_turn(raised)

    def rest(self, timeout_s: float | None, has_come: Callable[[], bool]) -> None:
        """Run every ready participant until something has come for the root or the time is over."""
        monotonic, ready = self.clock.monotonic, self._ready
        until_s = float("inf") if timeout_s is None else monotonic() + timeout_s
        while True:
            self.before()
            self.has_news = False
            while ready:
                ready.popleft().take_turn()
                # The root records what is complete soon: a long batch would make one step last.
                if self.has_news and has_come():
                    return
            if has_come():
                return
            if self._expire():
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
        for one in self.hosted:
            if one.deadline_s is not None and now >= one.deadline_s:
                self.let_go_on(one)
                one.has_expired = True
        return bool(self._ready)


class HubQueue:
    """A queue, as `queue.SimpleQueue`; waiting for it gives the others their turns."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._items: deque[Any] = deque()
        self._reader: HostedParticipant | None = None

    def put(self, item: Any) -> None:
        """Add an item, and let its reader go on."""
        self._items.append(item)
        reader = self._reader
        if reader is None:
            self._hub.has_news = True
        else:
            self._reader = None
            self._hub.let_go_on(reader)

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Return the oldest item; raises Empty after the time-out [s]."""
        hub, items = self._hub, self._items
        if not items and block:
            reader = self._reader = hub.current
            if reader is None:
                hub.rest(timeout, lambda: bool(items))
            else:
                try:
                    # This queue, or the time-out, gives it its next turn.
                    hub.pause(timeout)
                finally:
                    self._reader = None
        if not items:
            raise Empty
        return items.popleft()

    def empty(self) -> bool:
        """Return whether there is no item."""
        return not self._items

    def qsize(self) -> int:
        """Return how many items there are."""
        return len(self._items)
