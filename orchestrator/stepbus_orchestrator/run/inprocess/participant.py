"""One participant of a run in one process, in the place of its process."""

import contextlib
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TextIO

from stepbus_orchestrator.processes.activity import Activity, activity, children, descendants
from stepbus_orchestrator.processes.child import Process
from stepbus_orchestrator.run.inprocess.guard import Ended
from stepbus_orchestrator.run.inprocess.hub import Hub, Late, Turn
from stepbus_orchestrator.run.inprocess.turns import THREADS, TURN, TURNS
from stepbus_participant import HOST, Bus, Host, Ticket, append_to


class HostedParticipant(Turn, Process):
    """A participant that shares this process; it stands where its `Child` would.

    log: where it prints, unless it is `shown`: then where we do. program: what it does, and returns
    an exit code. words, number: the memory of the outside watcher, and which it is there. rest: is
    called after each turn. reap: has a program that it starts killed when we end. pid: of this
    process. late: how it missed a deadline, once it has.
    """

    def __init__(
        self,
        hub: Hub,
        ticket: Ticket,
        bus: Bus,
        log: Path,
        program: Callable[[], int],
        *,
        words: "memoryview[float]",
        number: int,
        shown: bool,
        rest: Callable[[], None],
        reap: Callable[[int], None],
    ) -> None:
        Turn.__init__(self, hub)
        Process.__init__(self, log)
        self.name = ticket.name
        self.pid = os.getpid()
        self._threads: set[threading.Thread] = set()
        self._noting = threading.RLock()
        self._words = words
        self._rest, self._reap = rest, reap
        self._number = number
        self._program = program
        self._host = Host(ticket, bus, self.log, self._keep)
        self._groups: list[int] = []
        self._children: set[int] = set()
        self._others: set[int] | None = None
        self._code: int | None = None
        self._output: TextIO = (
            sys.stdout if shown else os.fdopen(append_to(self.log), "a", 1, "utf-8", "replace")
        )
        self._streams = sys.stdout, sys.stderr

    # --- its turns ------------------------------------------------------------------------

    def enter(self) -> None:
        """Begin a turn: what is printed goes to its log."""
        self._streams = sys.stdout, sys.stderr
        sys.stdout = sys.stderr = self._output
        words = self._words
        words[TURN] = self._number
        words[TURNS] += 1

    def leave(self) -> None:
        """End a turn."""
        self._words[TURN] = 0
        sys.stdout, sys.stderr = self._streams
        self._rest()
        if self._threads:
            self._forget_threads()
        if self._others is not None:
            self._find_programs()

    def work(self) -> None:
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

    # --- what it has started ----------------------------------------------------------------

    @contextlib.contextmanager
    def starting(self, thread: threading.Thread) -> Iterator[None]:
        """Take note that it starts a thread, in this block."""
        with self._noting:
            self._threads.add(thread)
            self._words[THREADS + self._number] += 1
        try:
            yield
        except BaseException:
            with self._noting:
                self._threads.discard(thread)
                self._words[THREADS + self._number] = len(self._threads)
            raise

    def has_thread(self, number: int) -> bool:
        """Return whether it has started the thread of this number, which goes on."""
        with self._noting:
            return any(t.ident == number and t.is_alive() for t in self._threads)

    def _forget_threads(self) -> None:
        """Forget those that have ended."""
        with self._noting:
            self._threads = {t for t in self._threads if t.ident is None or t.is_alive()}
            self._words[THREADS + self._number] = len(self._threads)

    def before_program(self) -> None:
        """Take note that it is about to start a program."""
        if self._others is None:
            self._others = children(self.pid)

    def _find_programs(self) -> None:
        if self._others is not None:
            self._children |= children(self.pid) - self._others
            self._others = None

    def _keep(self, group: int) -> None:
        self._groups.append(group)
        self._reap(group)

    @property
    def has_programs(self) -> bool:
        """Return whether it waits for programs, as a bridge does."""
        return bool(self._groups)

    def kill_programs(self) -> None:
        """Kill the programs that it waits for, with all that they have started."""
        for group in self._groups:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(group, signal.SIGKILL)

    def _kill_children(self) -> None:
        """Kill the programs that it has started, with all that they have started."""
        self._find_programs()
        if not self._children:
            return
        # One that it has waited for is no child of ours any more; its number may be another's.
        for program in self._children & children(self.pid):
            for pid in (program, *descendants(program)):
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, signal.SIGKILL)

    # --- its process ------------------------------------------------------------------------

    def exit_code(self) -> int | None:
        """Return its exit code, negative for a signal; None while it takes part."""
        return self._code

    def activity(self) -> Activity:
        """Return what its programs are doing; it is this process."""
        return activity(*self._groups)

    def signal(self, number: int) -> None:
        """End it by a signal that would end its process; others do nothing."""
        if number in {signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV} and self._code is None:
            try:
                self.hub.end(self, Ended(number))
            except Ended:
                # It had not started.
                self._give_up(-number)

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has ended within a time [s]."""
        self.hub.rest(timeout_s, lambda: self._code is not None)
        return self._code is not None

    def end(self, grace_s: float = 0.0) -> None:
        """End it, whatever it waits for."""
        if self._code is None:
            self.kill_programs()
        self.signal(signal.SIGTERM)
        if self._code is None:
            # It has caught what should have ended it, and waits again. Nothing will wake it.
            self._give_up(-signal.SIGKILL)
        self._kill_children()
        if self._output is not sys.stdout:
            with contextlib.suppress(OSError):
                self._output.close()
