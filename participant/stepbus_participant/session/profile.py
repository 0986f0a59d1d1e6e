"""Where the time of a step goes, measured on request (`stepbus run --profile`)."""

import os
import sys
import time
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stepbus_participant.disk import make_file

_COLUMNS = ("step", "compute_ns", "wait_ns", "transport_ns", "record_ns")
_now_ns = time.perf_counter_ns


class Profiler:
    """Collects a row for each step of one participant; the rows become a CSV file.

    compute: in the participant's own `output` and `update`. wait: for the trigger and for inputs.
    record: to send log batches. transport: the rest, to receive, decode, check, encode and
    publish. It changes no message.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._rows = array("q")
        self._compute_ns = 0

    def finish(self, step: int, waited_ns: int, others_ns: int, record_ns: int) -> None:
        """Add the row of a step. others_ns: compute and transport [ns]."""
        own_ns, self._compute_ns = self._compute_ns, 0
        self._rows.extend((step, own_ns, waited_ns, others_ns - own_ns, record_ns))

    def timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function of the participant whose time counts as compute."""

        def timed(*arguments: Any) -> Any:
            start_ns = _now_ns()
            try:
                return function(*arguments)
            finally:
                self._compute_ns += _now_ns() - start_ns

        return timed

    def write(self) -> None:
        """Write all rows; a file that cannot be written is reported in the participant's log."""
        try:
            with os.fdopen(make_file(self._path), "w") as file:
                for row in (_COLUMNS, *zip(*[iter(self._rows)] * len(_COLUMNS), strict=True)):
                    file.write(",".join(map(str, row)) + "\n")
        except OSError as exc:
            # A full disk: the recording itself ends the run.
            sys.stderr.write(f"the profile {self._path} is incomplete: {exc.strerror}\n")
