"""Keeps what a participant does to its process from the others, who share it.

Python tells audit hooks of forks, signals and programs before they happen. A fork is
refused: its child would be a second orchestrator, with the same open files. What a process of its
own would do at its end is done at the end of the participant: its threads are awaited, and its
`atexit` functions called.
"""

import atexit
import contextlib
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from typing import Any, NoReturn

from stepbus_orchestrator.processes.activity import children, descendants

_JOIN_S = 0.05
_RUNS_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGURG)
_STOPS = (signal.SIGSTOP, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
_HARMLESS = (0, signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH)


class Ended(BaseException):
    """What ends a participant whose process would get a signal; `number` is that signal."""

    def __init__(self, number: int) -> None:
        super().__init__(f"ended by {signal.Signals(number).name}")
        self.number = number


class Belongings:
    """What a participant has in the process that it shares.

    name: of the participant. is_own: whether code with these globals is its own, not a library's.
    thread_count: where to count its threads, and the index there. threads: those it has started.
    programs: processes that it has started. has_started: whether there may be new ones.
    """

    def __init__(
        self,
        name: str,
        is_own: Callable[[dict[str, Any]], bool],
        thread_count: "tuple[memoryview[float], int]",
    ) -> None:
        self.name = name
        self.is_own = is_own
        self.has_started = False
        self._thread_count = thread_count
        self.threads: list[threading.Thread] = []
        self.programs: set[int] = set()
        self._exits: list[tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]] = []
        self._handlers: dict[int, Any] = {}
        self._before: set[int] = set()

    def add_thread(self, thread: threading.Thread) -> None:
        """Note that it starts a thread."""
        self.threads.append(thread)
        counts, index = self._thread_count
        counts[index] += 1

    def notice_program(self) -> None:
        """Note that it is about to start a program."""
        if not self.has_started:
            self.has_started, self._before = True, children(os.getpid())

    def find_programs(self) -> None:
        """Find the programs that it has started since."""
        if self.has_started:
            self.has_started = False
            self.programs |= children(os.getpid()) - self._before

    def kill_programs(self) -> None:
        """Kill the programs that it has started, with all that they have started."""
        self.find_programs()
        if not self.programs:
            return
        # One that it has waited for is no child of ours any more; its number may be another's.
        for program in self.programs & children(os.getpid()):
            for pid in (program, *descendants(program)):
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, signal.SIGKILL)

    def at_exit(
        self, function: Callable[..., Any], *args: Any, **options: Any
    ) -> Callable[..., Any]:
        """Call a function at its end."""
        self._exits.append((function, args, options))
        return function

    def not_at_exit(self, function: Callable[..., Any]) -> None:
        """Call a function at its end no more."""
        self._exits[:] = [row for row in self._exits if row[0] != function]

    def handle(self, number: int, handler: Any) -> Any:
        """Take a handler for a signal that is the run's; return the one before."""
        before = self._handlers.get(number, signal.SIG_DFL)
        self._handlers[number] = handler
        return before

    def has_threads(self) -> bool:
        """Return whether the end of the process would wait for a thread of it."""
        return any(thread.is_alive() and not thread.daemon for thread in self.threads)

    def remaining(self) -> list[threading.Thread]:
        """Return its threads that wait for nobody's word to end."""
        pool = sys.modules.get("concurrent.futures.thread")
        # Python tells them at its own end.
        pooled = getattr(pool, "_threads_queues", {})
        return [t for t in self.threads if t.is_alive() and not t.daemon and t not in pooled]

    def leave(self) -> None:
        """Do what Python does at the end of a process, in the turn of the participant."""
        while remaining := self.remaining():
            remaining[0].join(_JOIN_S)
        while self._exits:
            function, args, options = self._exits.pop()
            try:
                function(*args, **options)
            except Exception:  # noqa: BLE001  (as at the end of a process)
                sys.stderr.write(traceback.format_exc())


class Guard:
    """Watches the code of the participants of a run, while it is entered.

    current: returns whose code has the thread of the run; None: that of nobody who takes part.
    everybody: what each participant has.
    """

    def __init__(
        self, current: Callable[[], Belongings | None], everybody: Callable[[], list[Belongings]]
    ) -> None:
        self._current = current
        self._everybody = everybody
        self._pid = os.getpid()
        self._thread_id = threading.get_ident()

    def enter(self) -> None:
        """Watch from now on."""
        if not _state.is_hooked:
            # It stays for good, and does nothing while no guard is open.
            _state.is_hooked = True
            sys.addaudithook(_audit)
        if not _state.guards:
            _state.replace()
        _state.guards.append(self)

    def leave(self) -> None:
        """Watch no more."""
        _state.guards.remove(self)
        if not _state.guards:
            _state.restore()

    def owner(self) -> Belongings | None:
        """Return whose code runs on this thread; None: that of nobody who takes part."""
        if os.getpid() != self._pid:
            return None
        if threading.get_ident() == self._thread_id:
            return self._current()
        thread = threading.current_thread()
        return next((item for item in self._everybody() if thread in item.threads), None)


def _owner() -> Belongings | None:
    owners = (guard.owner() for guard in tuple(_state.guards))
    return next((owner for owner in owners if owner is not None), None)


# --- what is replaced ---------------------------------------------------------------------


class _State:
    """What is changed in this process while any guard is open."""

    def __init__(self) -> None:
        self.guards: list[Guard] = []
        self.is_hooked = False
        self.originals: dict[str, Any] = {}

    def replace(self) -> None:
        for (module, name), function in _REPLACED.items():
            self.originals[name] = getattr(module, name)
            setattr(module, name, function)

    def restore(self) -> None:
        for module, name in _REPLACED:
            setattr(module, name, self.originals[name])


_state = _State()


def _leave_process(status: int) -> NoReturn:
    owner = _owner()
    if owner is None or threading.current_thread() in owner.threads:
        _state.originals["_exit"](status)
    raise SystemExit(status)


def _start_thread(thread: threading.Thread) -> None:
    owner = _owner()
    if owner is not None:
        owner.add_thread(thread)
    _state.originals["start"](thread)


def _handle(number: int, handler: Any) -> Any:
    owner = _owner()
    if owner is None or number not in _RUNS_SIGNALS:
        return _state.originals["signal"](number, handler)
    return owner.handle(number, handler)


def _register(function: Callable[..., Any], *args: Any, **options: Any) -> Any:
    owner = _owner()
    # What a library registers is for all who use it, also behind the end of one of them.
    if owner is None or not owner.is_own(sys._getframe(1).f_globals):
        return _state.originals["register"](function, *args, **options)
    return owner.at_exit(function, *args, **options)


def _unregister(function: Callable[..., Any]) -> None:
    _state.originals["unregister"](function)
    owner = _owner()
    if owner is not None:
        owner.not_at_exit(function)


_REPLACED: dict[tuple[Any, str], Callable[..., Any]] = {
    (os, "_exit"): _leave_process,
    (signal, "signal"): _handle,
    (threading.Thread, "start"): _start_thread,
    (atexit, "register"): _register,
    (atexit, "unregister"): _unregister,
}


# --- what is audited ----------------------------------------------------------------------


def _on_fork(owner: Belongings, _arguments: tuple[Any, ...]) -> None:
    raise RuntimeError(
        f"{owner.name} forks the process that it shares with the orchestrator and all other "
        "participants; leave out --in-process, or use `subprocess`, or "
        "multiprocessing.get_context('spawn')"
    )


def _on_kill(owner: Belongings, arguments: tuple[Any, ...]) -> None:
    target, number = arguments[:2]
    if target in {os.getpid(), 0, -os.getpgid(0)}:
        _end(owner, number)


def _on_kill_group(owner: Belongings, arguments: tuple[Any, ...]) -> None:
    group, number = arguments[:2]
    if group in {os.getpgid(0), 0}:
        _end(owner, number)


def _end(owner: Belongings, number: int) -> None:
    """End the participant alone by a signal that it sends to its process."""
    if number in _STOPS:
        raise RuntimeError(
            f"{owner.name} stops the process that it shares with the orchestrator and all other "
            "participants; leave out --in-process"
        )
    if number in _HARMLESS:
        return
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    if number in _RUNS_SIGNALS or signal.getsignal(number) == signal.SIG_DFL:
        raise Ended(number)


def _on_program(owner: Belongings, _arguments: tuple[Any, ...]) -> None:
    owner.notice_program()


_EVENTS: dict[str, Callable[[Belongings, tuple[Any, ...]], None]] = {
    "os.fork": _on_fork,
    "os.forkpty": _on_fork,
    "os.kill": _on_kill,
    "os.killpg": _on_kill_group,
    "subprocess.Popen": _on_program,
    "os.posix_spawn": _on_program,
}


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    take = _EVENTS.get(event)
    if take is None or not _state.guards:
        return
    owner = _owner()
    if owner is not None:
        take(owner, arguments)
