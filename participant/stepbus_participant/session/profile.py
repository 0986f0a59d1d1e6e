"""Where the time of a step goes, measured on request (`stepbus run --profile`)."""

import contextlib
import os
import sys
import time
from array import array
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from stepbus_participant.bus.ticket import ProfileOrder
from stepbus_participant.disk import make_file
from stepbus_schemas import Waiting

from .outbox import Outbox
from .step_loop import StepLoop

_COLUMNS = ("step", "compute_ns", "wait_ns", "transport_ns", "record_ns")
_now_ns = time.perf_counter_ns


class Profiler:
    """Writes a line for each step of one participant, as CSV, once its steps are over.

    compute: in the participant's own `output` and `update`. wait: for the trigger and for inputs.
    record: to send log batches. transport: the rest, to receive, decode, check, encode and
    publish.

    order: where to. It changes no message. compute_ns, record_ns: of this step so far [ns].
    """

    def __init__(self, order: ProfileOrder, name: str) -> None:
        self.compute_ns = self.record_ns = 0
        self._path = Path(order.folder) / f"{name}.csv"
        self._rows = array("q")

    def outbox(self, *parts: Any) -> Outbox:
        """Return an outbox that is timed, and finishes the row of each step."""
        return _TimedOutbox(self, *parts)

    def finish(self, step: int, waited_ns: int, transport_ns: int) -> None:
        """Finish the row of a step. transport_ns: with compute, which is subtracted."""
        own_ns = self.compute_ns
        self._rows.extend((step, own_ns, waited_ns, transport_ns - own_ns, self.record_ns))
        self.compute_ns = self.record_ns = 0

    @contextlib.contextmanager
    def writing(self, loop: StepLoop) -> Iterator[None]:
        """Write a row for each step of a loop."""
        loop.output, loop.update = self._timed(loop.output), self._timed(loop.update)
        # Until here, empty batches have proven the link.
        self.record_ns = 0
        try:
            yield
        finally:
            try:
                with os.fdopen(make_file(self._path), "w") as file:
                    for row in (_COLUMNS, *zip(*[iter(self._rows)] * len(_COLUMNS), strict=True)):
                        file.write(",".join(map(str, row)) + "\n")
            except OSError as exc:
                # A full disk: the recording itself ends the run.
                sys.stderr.write(f"the profile {self._path} is incomplete: {exc.strerror}\n")

    def _timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            start_ns = _now_ns()
            try:
                return function(*arguments)
            finally:
                self.compute_ns += _now_ns() - start_ns

        return timed


class _TimedOutbox(Outbox):
    def __init__(self, profiler: Profiler, *parts: Any) -> None:
        super().__init__(*parts)
        self._profiler = profiler

    def finish(self, step: int, waited_ns: int, computed_ns: int) -> None:
        transport_ns = computed_ns - self._profiler.record_ns
        super().finish(step, waited_ns, computed_ns)
        self._profiler.finish(step, waited_ns, transport_ns)

    def flush(self, waiting: Waiting | None = None) -> None:
        start_ns = _now_ns()
        super().flush(waiting)
        if waiting is None:
            # A batch that is sent during a wait is part of the wait.
            self._profiler.record_ns += _now_ns() - start_ns
