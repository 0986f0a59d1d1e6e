"""The time of each step, as the suite reads it."""

import itertools
import json
import sys
import time


class Clock:
    """Times steps, and prints what the suite reads."""

    def __init__(self) -> None:
        self._at = [time.perf_counter_ns()]

    def tick(self) -> None:
        """End a step."""
        self._at.append(time.perf_counter_ns())

    def show(self, **more: float) -> None:
        """Print rate [steps/s] and percentiles of the step time [µs] as JSON, and more."""
        at = self._at
        spans = sorted(b - a for a, b in itertools.pairwise(at))
        count = len(spans)
        shown = {
            "rate": count / ((at[-1] - at[0]) * 1e-9),
            "p50": spans[count // 2] * 1e-3,
            "p99": spans[min(count - 1, count * 99 // 100)] * 1e-3,
            "max": spans[-1] * 1e-3,
            **more,
        }
        sys.stdout.write(json.dumps(shown) + "\n")
        sys.stdout.flush()
