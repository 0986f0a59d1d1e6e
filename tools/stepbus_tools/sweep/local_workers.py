"""Workers on this machine: each run is a fork of one process that has loaded what runs need."""

import contextlib
import os
import socket
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Self

import msgspec

from stepbus_orchestrator.errors import StartFailed
from stepbus_orchestrator.processes import PYTHON
from stepbus_orchestrator.scenario.program import PYTHON as INTERPRETER
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.bundle import Bundle
from stepbus_tools.sweep.pool import WAIT_S, Answer, PoolOptions, wait_for_start
from stepbus_tools.sweep.rows import ResultRow

_COMMAND = (*INTERPRETER, "-m", "stepbus_tools.sweep.fork_server")
_LOAD_S = 120.0
"""How long the fork server may take to load what runs need [s]."""
_END_S = 10.0
"""How long it may take to end its runs and to remove its folder [s]."""
_SILENT_S, _LOST_S = 5.0, 30.0
"""After how long a silent fork server is asked for an answer, and is given up [s]."""


class LocalWorkers:
    """Runs points in forks of a fork server.

    Raises StartFailed where it does not start, has ended or does not answer, or a metric cannot be
    loaded.
    """

    def __init__(self, bundle: Bundle, options: PoolOptions, interrupt: threading.Event) -> None:
        self._options = options
        self._interrupt = interrupt
        self._first = bundle, options
        self._is_asked = False

    def __enter__(self) -> Self:
        """Start the fork server."""
        ours, theirs = socket.socketpair()
        self._channel = Connection(ours.detach())
        with theirs:
            try:
                self._server = subprocess.Popen(
                    [*_COMMAND, str(theirs.fileno())],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    pass_fds=[theirs.fileno()],
                    env={**os.environ, **PYTHON},
                    start_new_session=True,
                )
            except OSError as exc:
                self._channel.close()
                raise StartFailed(f"could not start a worker: {exc.strerror}") from exc
        with contextlib.ExitStack() as stack:
            stack.callback(self._end)
            self._send(self._first)
            wait_for_start(self._channel.poll, _LOAD_S, self._interrupt)
            if error := self._received():
                raise StartFailed(f"could not start a worker: {error}")
            stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """End all runs, and the fork server."""
        self._end()

    def _end(self) -> None:
        """Close the channel: the fork server ends its runs then, removes its folder, and ends."""
        self._channel.close()
        try:
            self._server.wait(_END_S)
        except subprocess.TimeoutExpired:
            # Its runs end with it.
            self._server.kill()
            self._server.wait()  # no time-out: it was killed

    def cores(self) -> int:
        """Return how many runs may go on at once."""
        return self._options.jobs or len(os.sched_getaffinity(0))

    def start(self, point: Point) -> int:
        """Start a run; return its number."""
        self._send(point)
        return point.number

    def answers(self, _keys: Sequence[int], timeout_s: float) -> Iterator[tuple[int, Answer]]:
        """Yield number and answer of the next run that ends, as of `Workers`."""
        if not self._channel.poll(timeout_s):
            self._ask()
        elif (answer := self._received()) is not None:
            number, row, error = answer
            answered = Answer((msgspec.json.decode(row, type=ResultRow), {})) if row else None
            yield number, answered or Answer(error=error)

    def plot(self, pictures: Mapping[int, Path], interrupt: threading.Event) -> None:
        """Plot runs in forks, as of `Workers`."""
        for picture in pictures.items():
            self._send(picture)
        left = set(pictures)
        while left and not interrupt.is_set():
            left -= {number for number, _ in self.answers(list(left), WAIT_S)}

    def _ask(self) -> None:
        """Ask a silent fork server for an answer; raises StartFailed where none comes."""
        silent_s = time.monotonic() - self._heard
        if silent_s > _LOST_S:
            raise StartFailed(
                f"process {self._server.pid}, which starts the runs, does not answer; is it "
                "stopped? Run the same command again to resume"
            )
        if silent_s > _SILENT_S and not self._is_asked:
            self._is_asked = True
            self._send(None)

    def _send(self, message: object) -> None:
        try:
            self._channel.send(message)
        except OSError as exc:
            raise StartFailed(self._ended()) from exc

    def _received(self) -> Any:
        try:
            answer = self._channel.recv()
        except (EOFError, OSError) as exc:
            raise StartFailed(self._ended()) from exc
        self._heard, self._is_asked = time.monotonic(), False
        return answer

    def _ended(self) -> str:
        return (
            f"process {self._server.pid}, which starts the runs, has ended; run the same command "
            "again to resume"
        )
