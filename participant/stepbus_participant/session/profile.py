"""Where the time of a step goes, measured on request (`stepbus run --profile`)."""

import contextlib
import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Self, TextIO

from stepbus_participant.bus.ticket import ProfileOrder
from stepbus_participant.disk import make_file, write_file
from stepbus_schemas import Waiting

from .outbox import Outbox
from .step_loop import StepLoop

_PERIOD_S = 0.001
_JOIN_S = 1.0
_MOST_SAMPLES = 200_000
_SCHEMA = "https://www.speedscope.app/file-format-schema.json"
_Place = tuple[str, str, int]


class Sampler:
    """Samples the calls below one frame about every millisecond, until it is left.

    frame: below it a participant works; samples without it are not the participant's, in a run in
    one process. path: the file, written at the end.
    """

    def __init__(self, name: str, frame: FrameType, path: Path) -> None:
        self._name = name
        self._frame = frame
        self._path = path
        self._thread = threading.get_ident()
        self._over = threading.Event()
        self._places: dict[_Place, int] = {}
        self._samples: list[list[int]] = []
        self._weights: list[float] = []
        self._worker = threading.Thread(target=self._work, name="sampler", daemon=True)

    def __enter__(self) -> Self:
        self._worker.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._over.set()
        self._worker.join(_JOIN_S)
        del self._frame
        with _unless_full(self._path):
            write_file(self._path, json.dumps(self._profile()).encode())

    def _work(self) -> None:
        sampled_at = time.perf_counter()
        while not self._over.wait(_PERIOD_S) and len(self._samples) < _MOST_SAMPLES:
            stack = self._stack()
            now = time.perf_counter()
            if stack:
                self._samples.append(stack)
                self._weights.append(now - sampled_at)
            sampled_at = now

    def _stack(self) -> list[int]:
        """Return the places of the calls below the frame, outermost first; empty: elsewhere."""
        frame, frames = sys._current_frames().get(self._thread), list[int]()
        while frame is not None:
            if frame is self._frame:
                return frames[::-1]
            code = frame.f_code
            place = (code.co_qualname, code.co_filename, code.co_firstlineno)
            frames.append(self._places.setdefault(place, len(self._places)))
            frame = frame.f_back
        return []

    def _profile(self) -> dict[str, object]:
        frames = [{"name": name, "file": file, "line": line} for name, file, line in self._places]
        sampled = {
            "type": "sampled",
            "name": self._name,
            "unit": "seconds",
            "startValue": 0,
            "endValue": sum(self._weights),
            "samples": self._samples,
            "weights": self._weights,
        }
        return {"$schema": _SCHEMA, "shared": {"frames": frames}, "profiles": [sampled]}


@contextlib.contextmanager
def _unless_full(path: Path) -> Iterator[None]:
    """Leave out what the disk has no room for: the recording itself ends the run."""
    try:
        yield
    except OSError as exc:
        sys.stderr.write(f"the profile {path} is incomplete: {exc.strerror}\n")


_COLUMNS = ("step", "compute_ns", "wait_ns", "transport_ns", "record_ns")
_BUFFER_BYTES = 1 << 18
_now_ns = time.perf_counter_ns


class Profiler:
    """Writes a line for each step of one participant, as CSV.

    compute: in the participant's own `output` and `update`. wait: for the trigger and for inputs.
    record: to send log batches. transport: the rest, to receive, decode, check, encode and
    publish.

    order: where to, and whether to sample the stack too. It changes no message.
    record_ns: what the batches of this step have taken so far [ns].
    """

    def __init__(self, order: ProfileOrder, name: str) -> None:
        self.record_ns = 0
        self._order = order
        self._name = name
        self._path = Path(order.folder) / f"{name}.csv"
        self._compute_ns = 0
        self._file: TextIO | None = None

    def outbox(self, *parts: Any) -> Outbox:
        """Return an outbox that is timed, and finishes the row of each step."""
        return _TimedOutbox(self, *parts)

    def finish(self, step: int, waited_ns: int, transport_ns: int) -> None:
        """Finish the row of a step. transport_ns: with compute, which is subtracted."""
        compute_ns = self._compute_ns
        self._write((step, compute_ns, waited_ns, transport_ns - compute_ns, self.record_ns))
        self._compute_ns = self.record_ns = 0

    @contextlib.contextmanager
    def writing(self, loop: StepLoop, frame: FrameType) -> Iterator[None]:
        """Write a row for each step of a loop; frame: of the function whose calls are sampled."""
        loop.output, loop.update = self._timed(loop.output), self._timed(loop.update)
        self._file = os.fdopen(make_file(self._path), "w", _BUFFER_BYTES)
        self._write(_COLUMNS)
        # Until here, empty batches have proven the link.
        self.record_ns = 0
        try:
            with self._sampled(frame):
                yield
        finally:
            self._close()

    def _write(self, row: Sequence[object]) -> None:
        if self._file is not None:
            try:
                self._file.write(",".join(map(str, row)) + "\n")
            except OSError:
                self._close()

    def _close(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            with _unless_full(self._path):
                file.close()

    def _timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            start_ns = _now_ns()
            try:
                return function(*arguments)
            finally:
                self._compute_ns += _now_ns() - start_ns

        return timed

    def _sampled(self, frame: FrameType) -> contextlib.AbstractContextManager[object]:
        if self._name not in self._order.sampled:
            return contextlib.nullcontext()
        return Sampler(self._name, frame, self._path.with_suffix(".speedscope.json"))


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
