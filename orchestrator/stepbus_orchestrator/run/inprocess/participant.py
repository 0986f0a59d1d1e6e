"""One participant of a run in one process, in the place of its process."""

import contextlib
import os
import signal
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TextIO

from stepbus_orchestrator.processes.activity import NOTHING, Activity
from stepbus_orchestrator.processes.child import Process
from stepbus_orchestrator.run.inprocess.hub import Hub, Late, Turn
from stepbus_orchestrator.run.inprocess.turns import TURN, TURNS
from stepbus_participant import HOST, Bus, Host, Ticket, append_to


class Ended(BaseException):
    """Ends a participant whose process would get the signal `number`."""

    def __init__(self, number: int) -> None:
        super().__init__(f"ended by {signal.Signals(number).name}")
        self.number = number


class HostedParticipant(Turn, Process):
    """A participant that shares this process; it stands where its `Child` would.

    log: where it prints, unless it is `shown`: then where we do. program: what it does, and returns
    an exit code. words, number: the memory of the outside watcher, and which it is there. pid: of
    this process. late: how it missed a deadline, once it has.
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
    ) -> None:
        Turn.__init__(self, hub)
        Process.__init__(self, log)
        self.name = ticket.name
        self.pid = os.getpid()
        self._words = words
        self._number = number
        self._program = program
        self._host = Host(ticket, bus)
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
        self.signal(signal.SIGTERM)
        if self._code is None:
            # It has caught what should have ended it, and waits again. Nothing will wake it.
            self._give_up(-signal.SIGKILL)
        if self._output is not sys.stdout:
            with contextlib.suppress(OSError):
                self._output.close()
