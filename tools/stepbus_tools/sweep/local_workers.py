"""Workers on this machine: each run is a fork of one process that has loaded what runs need."""

import contextlib
import os
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from stepbus_orchestrator.errors import StartFailed
from stepbus_participant import need
from stepbus_tools.sweep.axes import Point
from stepbus_tools.sweep.bundle import Bundle
from stepbus_tools.sweep.pool import WAIT_S, Answer, PoolOptions, wait_for_start
from stepbus_tools.sweep.server_process import early, start_server

_LOAD_S = 120.0
"""How long the fork server may take to load what runs need [s]."""
_END_S = 10.0
"""How long it may take to end its runs and to remove its folder [s]."""
_LOST_S = 30.0
"""How long a fork server with runs may be silent [s]."""


class LocalWorkers:
    """Runs points in forks of a fork server.

    Raises StartFailed where it does not start, has ended or does not answer, or a metric cannot be
    loaded.
    """

    def __init__(self, bundle: Bundle, options: PoolOptions, interrupt: threading.Event) -> None:
        self._options = options
        self._interrupt = interrupt
        self._first = bundle, options

    def __enter__(self) -> Self:
        """Start the fork server."""
        try:
            self._server, self._channel = early.pop() if early else start_server()
        except OSError as exc:
            raise StartFailed(f"could not start a worker: {exc.strerror}") from exc
        with contextlib.ExitStack() as stack:
            stack.push(self)
            self._send(self._first)
            # While it prepares the runs; it is what the table is written with.
            need("a sweep", "pyarrow.parquet")
            wait_for_start(self._channel.poll, _LOAD_S, self._interrupt)
            if error := self._received():
                raise StartFailed(f"could not start a worker: {error}")
            stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
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
        self._send((point.number, point))
        return point.number

    def answers(self, _keys: Sequence[int], timeout_s: float) -> Iterator[tuple[int, Answer]]:
        """Yield number and answer of the next run that ends, as of `Workers`."""
        if self._channel.poll(timeout_s):
            if (answer := self._received()) is not None:
                number, row, error = answer
                yield number, (row, {}, error)
        elif time.monotonic() - self._heard > _LOST_S:
            raise StartFailed(
                f"process {self._server.pid}, which starts the runs, does not answer; is it "
                "stopped? Run the same command again to resume"
            )

    def plot(self, pictures: Mapping[int, Path], interrupt: threading.Event) -> None:
        """Plot runs in forks, as of `Workers`."""
        for picture in pictures.items():
            self._send(picture)
        left = set(pictures)
        while left and not interrupt.is_set():
            left -= {number for number, _ in self.answers(list(left), WAIT_S)}

    def _send(self, message: object) -> None:
        with self._reached():
            self._channel.send(message)

    def _received(self) -> Any:
        with self._reached():
            return self._channel.recv()

    @contextlib.contextmanager
    def _reached(self) -> Iterator[None]:
        """Raise StartFailed where the fork server has ended."""
        try:
            yield
        except (EOFError, OSError) as exc:
            raise StartFailed(
                f"process {self._server.pid}, which starts the runs, has ended; run the same "
                "command again to resume"
            ) from exc
        self._heard = time.monotonic()
