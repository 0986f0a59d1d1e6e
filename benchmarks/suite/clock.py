"""The time of each step, as the suite reads it, and the machine that it is of."""

import itertools
import json
import os
import platform
import sys
import time
from pathlib import Path


def machine() -> str:
    """Return processor, cores, system and Python in a line: without them, a figure says little."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return (
        f"{models[0] if models else platform.machine()}, {os.cpu_count()} cores, "
        f"{platform.system()} {platform.release().partition('-')[0]}, "
        f"Python {platform.python_version()}"
    )


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
