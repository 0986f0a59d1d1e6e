"""A host that is reached over SSH: its agent, and the processes that this has started."""

import contextlib
import os
import shlex
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from stepbus_orchestrator.errors import Interrupted, StartFailed
from stepbus_orchestrator.processes.activity import NOTHING, Activity
from stepbus_orchestrator.processes.child import Process
from stepbus_participant import append_to

from . import wire
from .hosts_file import HostSpec

_CONNECT_S = 10
_GREET_S = 30.0
_FILES_S = 600.0
_END_S = 8.0
_KILL_S = 5.0
_SILENT_S = 1.5
"""Three times as long as two beats are apart."""
_SHOWN = 400
_LONGEST = 1 << 24
"""What an agent sends is smaller, such as 64 KiB of output [bytes]."""


def ssh_command(spec: HostSpec, there: str) -> list[str]:
    """Return the command that runs another one on a host, and asks the user nothing."""
    options = ("-T", "-oBatchMode=yes", f"-oConnectTimeout={_CONNECT_S}", *spec.ssh)
    return ["ssh", *options, "--", spec.destination, there]


class Connection:
    """The agent on a host.

    name: of the host in the scenario. interrupt: ends the wait for an answer. pid: of `ssh`.

    Raises StartFailed where it cannot be reached, or stepbus is not there.
    """

    def __init__(
        self, name: str, spec: HostSpec, order: wire.Open, interrupt: threading.Event
    ) -> None:
        self.name, self.spec, self._interrupt = name, spec, interrupt
        self._lease_s = order.lease_s
        self._processes: dict[str, RemoteProcess] = {}
        self._queue = SimpleQueue[wire.Frame | None]()
        # Until it has said anything, it has as long as for its greeting.
        self._lost, self._heard = "", time.monotonic() + _GREET_S
        self._answers = SimpleQueue[Any]()
        self._left: list[tuple[str, str]] = []
        self._said = tempfile.TemporaryFile()  # noqa: SIM115  (open as long as `ssh`)
        there = shlex.join([spec.python, "-P", "-m", "stepbus_hosts.agent"])
        try:
            self._ssh = subprocess.Popen(
                ssh_command(spec, f"exec {there}"),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._said,
                # Ctrl-C in the terminal does not reach it.
                start_new_session=True,
            )
        except OSError as exc:
            raise StartFailed(f"host {name}: ssh cannot be started: {exc.strerror}") from exc
        self.pid = self._ssh.pid
        self._threads = [
            threading.Thread(target=work, name=f"ssh {name}", daemon=True)
            for work in (self._read, self._write)
        ]
        for thread in self._threads:
            thread.start()
        self._queue.put(order)

    def greeting(self) -> wire.Greeting:
        """Wait for what the agent says of itself; raises StartFailed where it says nothing."""
        greeting: wire.Greeting = self._answer(_GREET_S)
        return greeting

    def deliver(self, missing: Mapping[str, bytes]) -> None:
        """Send the files that the host lacks, SHA-256 → content."""
        if missing:
            self._queue.put(wire.Content(dict(missing)))

    def start(self, order: wire.Start, log: Path) -> "RemoteProcess":
        """Start a participant; raises StartFailed where that cannot be done."""
        process = self._processes[order.name] = RemoteProcess(self, order.name, log)
        os.close(append_to(log))  # There is one, as of those here, also where nothing is printed.
        self._queue.put(order)
        started: wire.Started = self._answer(_FILES_S, order.name)
        if started.problem:
            text = f"{order.name}: on {self.name}: {started.problem}"
            raise StartFailed(text, participant=order.name)
        process.remote_pid = started.pid
        return process

    def probe(self, order: wire.Probe) -> wire.Probed:
        """Return what a port is like from there."""
        self._queue.put(order)
        probed: wire.Probed = self._answer(_GREET_S)
        return probed

    def _answer(self, wait_s: float, participant: str | None = None) -> Any:
        give_up, answer = time.monotonic() + wait_s, None
        while answer is None:
            with contextlib.suppress(Empty):
                answer = self._answers.get(timeout=0.1)
            if self._interrupt.is_set():
                raise Interrupted(f"interrupted while waiting for host {self.name}")
            if answer is None and (why := self.lost()):
                answer = wire.Problem(why)
            if answer is None and time.monotonic() > give_up:
                answer = wire.Problem(f"has not answered for {wait_s:g} s; {self._hint()}")
        if isinstance(answer, wire.Problem):
            raise StartFailed(
                f"host {self.name} ({self.spec.destination}): {answer.text}",
                participant=participant,
            )
        return answer

    def _hint(self) -> str:
        spec = self.spec
        return f"try `{shlex.join(['ssh', *spec.ssh, spec.destination, spec.python, '--version'])}`"

    def send(self, frame: wire.Frame) -> None:
        """Send the agent a frame."""
        self._queue.put(frame)

    def lost(self) -> str:
        """Return why the host is out of reach; empty: it is not."""
        silent_s = time.monotonic() - self._heard
        if not self._lost and silent_s > self._lease_s:
            self._lost = f"nothing has come from it for {silent_s:.1f} s"
            self._ssh.kill()
        return self._lost

    def silent_s(self) -> float:
        """Return how long nothing has come from the host [s]."""
        return time.monotonic() - self._heard

    def close(self) -> list[tuple[str, str]]:
        """End all that is left there; return (participant, warning) of what had to be ended."""
        self._queue.put(wire.Close())
        self._queue.put(None)
        left_s = 0.0 if self._lost else self._lease_s - self.silent_s()
        try:
            self._ssh.wait(min(max(0.1, left_s), _END_S))
        except subprocess.TimeoutExpired:
            self._ssh.kill()
            self._ssh.wait()  # no time-out: it was killed
            if not self._lost:
                self._left.append((self.name, f"its agent did not end within {_END_S:g} s"))
        for thread in self._threads:
            thread.join(_KILL_S)
        self._said.close()
        if self._ssh.stdout is not None:
            self._ssh.stdout.close()
        return self._left

    # --- its threads --------------------------------------------------------------------------

    def _write(self) -> None:
        assert self._ssh.stdin is not None  # noqa: S101
        beat_s = min(0.5, self._lease_s / 4)
        with contextlib.suppress(OSError):
            while True:
                try:
                    frame = self._queue.get(timeout=beat_s)
                except Empty:
                    frame = wire.Beat()
                if frame is None:
                    break
                self._ssh.stdin.write(wire.packed(frame))
                self._ssh.stdin.flush()
        with contextlib.suppress(OSError):
            self._ssh.stdin.close()

    def _read(self) -> None:
        assert self._ssh.stdout is not None  # noqa: S101
        frames = wire.Frames(self._ssh.stdout.fileno(), wire.MARK, _LONGEST)
        why = ""
        try:
            while True:
                for frame in frames.read():
                    self._heard = time.monotonic()
                    self._take(frame)
        except EOFError:
            self._said.seek(0)
            said = self._said.read(1 << 16).decode(errors="replace").strip()
            why = " ".join(said.splitlines()[-3:])[-_SHOWN:] or "the connection was closed"
            if "No module named 'stepbus_hosts'" in why:
                why = f"stepbus is not installed for {self.spec.python} there"
        except Exception as exc:  # noqa: BLE001  (whatever it sends, it is lost)
            why = f"does not speak as its agent: {exc}"
        self._lost = self._lost or why
        self._answers.put(wire.Problem(f"{why}; {self._hint()}"))
        for process in self._processes.values():
            process.is_over.set()

    def _take(self, frame: wire.Frame) -> None:
        match frame:
            case wire.Printed(name=name, text=text):
                with os.fdopen(append_to(self._processes[name].log), "ab") as file:
                    file.write(text)
            case wire.Ended(name=name, code=code):
                self._processes[name].code = code
                self._processes[name].is_over.set()
            case wire.Left(rows=rows):
                self._left += [(name, f"on {self.name}, {text}") for name, text in rows]
            case wire.Greeting() | wire.Probed() | wire.Started() | wire.Problem():
                self._answers.put(frame)


class RemoteProcess(Process):
    """A participant's process on another host.

    remote_pid: its process id there. is_silent, cut: those of the gateway for its link.
    """

    def __init__(self, host: Connection, name: str, log: Path) -> None:
        super().__init__(log)
        self._host, self._name = host, name
        self.remote_pid = 0
        self.code: int | None = None
        self.is_over = threading.Event()
        self.is_silent: Callable[[], str] = str
        self.cut: Callable[[], object] = str
        self._is_terminated = False

    def where(self) -> str:
        """Return its process id there, and its host."""
        return f"pid {self.remote_pid} on {self._host.name}"

    def exit_code(self) -> int | None:
        """Return its exit code; 255, as `ssh` does, where its host is lost."""
        if self.code is None and self._host.lost():
            return 255
        return self.code

    def how_it_ended(self) -> str:
        """Return a phrase for its end."""
        if self.code is None and (why := self._host.lost()):
            return f"is lost with its host {self._host.name}: {why}"
        return super().how_it_ended()

    def silence(self) -> str:
        """Return that nothing comes from its host, and since when; empty: its host answers."""
        silent_s = self._host.silent_s()
        if silent_s > _SILENT_S:
            return f"nothing has come from host {self._host.name} for {silent_s:.1f} s"
        return self.is_silent()

    def activity(self) -> Activity:
        """Return nothing: what it does there is not known here."""
        return NOTHING

    def signal(self, number: int) -> None:
        """Send it a signal, and all it has started."""
        if number == signal.SIGKILL:
            # Its host may not get that, and what it does not read holds up the others.
            self.cut()
        self._host.send(wire.Signal(self._name, number))

    def wait(self, timeout_s: float) -> bool:
        """Return whether it has ended within a time [s]."""
        give_up = time.monotonic() + timeout_s
        while self.exit_code() is None and (left_s := give_up - time.monotonic()) > 0:
            self.is_over.wait(min(left_s, 0.1))
        return self.exit_code() is not None

    def terminate(self) -> None:
        """Ask it once to end, and all it has started."""
        if self.exit_code() is None and not self._is_terminated:
            self._is_terminated = True
            self.signal(signal.SIGTERM)
            self.signal(signal.SIGCONT)

    def end(self, grace_s: float = 1.0) -> None:
        """Terminate it, then kill it and all it has started."""
        self.terminate()
        if not self.wait(grace_s):
            self.signal(signal.SIGKILL)
            # Meanwhile, nothing answers the others.
            if self._host.silent_s() < _SILENT_S:
                self.wait(_KILL_S)
