"""One participant of a run in one process, in the place of its process."""

import contextlib
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

from stepbus_orchestrator.processes.activity import Activity, activity
from stepbus_orchestrator.processes.child import BoundedLog
from stepbus_orchestrator.processes.turns import Row, Turns
from stepbus_orchestrator.run.inprocess.guard import Belongings, Ended
from stepbus_orchestrator.run.inprocess.hub import Hub
from stepbus_orchestrator.run.inprocess.program import ScenarioModules
from stepbus_orchestrator.run.kernel.participants import KeptThread
from stepbus_participant import (
    HOST,
    Host,
    LoopbackBus,
    Ticket,
    append_to,
    last_error,
)


class HostedBus(LoopbackBus):
    """A participant's bus in memory, which counts what it publishes.

    peer: the orchestrator's. name: of the participant. is_leaf: it has no link to others. counter:
    where to count its outputs, and the index there.
    """

    def __init__(
        self,
        peer: LoopbackBus,
        name: str,
        *,
        counter: "tuple[memoryview[float], int]",
        is_leaf: bool = False,
    ) -> None:
        super().__init__(peer, peer.queue, is_leaf=is_leaf)
        self._counter = counter
        self._key = f"out/{name}"

    def publisher(self, key: str, encoding: str, *, remote: bool = False) -> Callable[..., None]:
        """Return a function that publishes bytes; it counts outputs."""
        put = super().publisher(key, encoding, remote=remote)
        if key != self._key:
            return put
        counts, index = self._counter

        def counted_put(data: bytes, **options: Any) -> None:
            counts[index] += 1
            put(data, **options)

        return counted_put


class Late(BaseException):
    """Interrupts a participant that keeps the thread past its deadline."""


class HostedParticipant:
    """A participant that shares this process; it stands where its `Child` would.

    name: the participant. log: where it prints. pid: of this process. late: how it missed a
    deadline, once it has. belongings: what it has in this process. number: which it is, to
    who watches from outside.
    """

    def __init__(
        self,
        ticket: Ticket,
        bus: HostedBus,
        program: Callable[[], int],
        *,
        modules: ScenarioModules,
        hub: Hub,
        log: Path,
        take_program: Callable[[int], None],
        shown: bool,
        number: int,
        turns: Turns,
    ) -> None:
        self.name = ticket.name
        self.log = log
        self.bus = bus
        self.pid = os.getpid()
        self.late: KeptThread | None = None
        self.output: TextIO = (
            sys.stdout if shown else os.fdopen(append_to(log), "a", 1, "utf-8", "replace")
        )
        self.belongings = Belongings(
            self.name, modules.has_written, (turns.words, Row.THREADS + number)
        )
        self._hub = hub
        self.number = number
        self._words = turns.words
        self._program = program
        self._modules = modules
        self._place = Host(ticket, bus, log, self._keep)
        self._take_program = take_program
        self._programs: list[int] = []
        self._code: int | None = None
        self._turn = hub.add(self._work)
        self._turn.enter, self._turn.leave = self._enter, self._leave
        self._bounded_log = BoundedLog(log)
        self._streams = sys.stdout, sys.stderr

    def _enter(self) -> None:
        self._streams = sys.stdout, sys.stderr
        sys.stdout = sys.stderr = self.output
        words = self._words
        words[1] = self.number
        words[0] += 1

    def _leave(self) -> None:
        self._words[1] = 0
        sys.stdout, sys.stderr = self._streams
        self._modules.keep()
        if self.belongings.has_started:
            self.belongings.find_programs()

    def _work(self) -> None:
        """Run the program to its end, and keep its exit code as its process would."""
        HOST.set(self._place)
        try:
            code = self._run()
            self.belongings.leave()
        except SystemExit as exc:
            code = self._code_of(exc.code)
        except Ended as exc:
            code = -exc.number
        except Late:
            self._print(traceback.format_exc())
            code = -signal.SIGKILL
        except BaseException:  # noqa: BLE001  (whatever ends a program ends its process only)
            self._print(traceback.format_exc())
            code = 1
        finally:
            self._place.bus.close()
        self._code = code

    def _run(self) -> int:
        try:
            return self._program()
        except SystemExit as exc:
            return self._code_of(exc.code)
        except Exception:  # noqa: BLE001  (it ends its process only)
            self._print(traceback.format_exc())
            return 1

    def _code_of(self, value: Any) -> int:
        if value is None or isinstance(value, int):
            return value or 0
        self._print(f"{value}\n")
        return 1

    def _print(self, text: str) -> None:
        # On a full disk its log lacks its last words, as `log_problem` says.
        with contextlib.suppress(OSError):
            self.output.write(text)

    def has_thread(self) -> bool:
        """Return whether it has the thread, as another thread sees it."""
        return self._hub.current is self._turn

    def is_running(self) -> bool:
        """Return whether its own code called this, on the thread that it shares."""
        return self._turn.is_running

    def _keep(self, program: int) -> None:
        self._programs.append(program)
        self._take_program(program)

    def kill_programs(self) -> None:
        """Kill the programs that it has started, with all that they have started."""
        for program in self._programs:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(program, signal.SIGKILL)

    def exit_code(self) -> int | None:
        """Return its exit code, negative for a signal; None while it takes part."""
        return self._code

    def how_it_ended(self) -> str:
        """Return its end in words."""
        if self._code is not None and self._code < 0:
            return f"was killed by {signal.Signals(-self._code).name}"
        return f"exited with code {self._code}"

    def last_error(self) -> str:
        """Return the last error it printed, or its last line, or nothing."""
        return last_error(self.log)

    def limit_log(self) -> None:
        """Keep the head and the tail of its log, once that has become large."""
        self._bounded_log.limit()

    def log_problem(self) -> str:
        """Return why its log may lack its last words, such as a full disk; empty: it has them."""
        return self._bounded_log.problem()

    @property
    def has_programs(self) -> bool:
        """Return whether it has started programs, as a bridge does."""
        return bool(self._programs)

    def activity(self) -> Activity:
        """Return what its programs are doing; it is this process."""
        activities = [activity(program) for program in self._programs]
        return Activity(
            is_stopped=any(item.is_stopped for item in activities),
            waits_for_disk=any(item.waits_for_disk for item in activities),
            is_running=any(item.is_running for item in activities),
            cpu_s=sum(item.cpu_s for item in activities),
        )

    def signal(self, number: int) -> None:
        """End it by a signal that would end its process; others do nothing."""
        if number in {signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV} and self._code is None:
            try:
                self._hub.end(self._turn, Ended(number))
            except Ended:
                # It had not started.
                self._give_up(number)

    def _give_up(self, number: int) -> None:
        self._code = -number
        self._place.bus.close()

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has ended within a time [s]."""
        self._hub.rest(time.monotonic() + timeout_s, lambda: self._code is not None)
        return self._code is not None

    def terminate(self) -> None:
        """Nothing: `end` needs no time."""

    def end(self, _grace_s: float = 0.0) -> None:
        """End it, whatever it waits for."""
        if self._code is None:
            self.kill_programs()
        self.signal(signal.SIGTERM)
        if self._code is None:
            # It has caught what should have ended it, and waits again. Nobody will wake it.
            self._give_up(signal.SIGKILL)
        self.belongings.kill_programs()
        if self.output is not sys.stdout:
            with contextlib.suppress(OSError):
                self.output.close()
