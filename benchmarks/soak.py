"""A long run: no process grows, and its report takes little time and memory.

`python benchmarks/soak.py [--steps N]` runs two_link with recording on and samples the memory of
every process. It passes if the resident memory of each is at the end within 1 MB of what it was at
a tenth of the run (means over a twentieth), and if the report, made by a process of its own, takes
less than 20 s and 300 MB.
"""

import argparse
import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import psutil

STEPBUS = (sys.executable, "-m", "stepbus_orchestrator.cli")
STEP_MS = 5
MOST_GROWTH_MB = 1.0
MOST_REPORT_S = 20.0
MOST_REPORT_MB = 300.0
_SAMPLE_S = 1.0

Sizes = Mapping[str, float]
"""Process → its size [MB]."""


def run(steps: int, folder: Path) -> Sequence[Sizes]:
    """Run two_link; return samples of the sizes of its processes while it has participants."""
    words = ["two_link", "--set", f"duration={steps * STEP_MS}ms", "--no-report"]
    samples: list[Sizes] = []
    with subprocess.Popen([*STEPBUS, "run", *words, "--out", str(folder)]) as process:
        own = psutil.Process(process.pid)
        while process.poll() is None:
            with contextlib.suppress(psutil.NoSuchProcess):
                if children := own.children(recursive=True):
                    samples.append(dict(map(sample, (own, *children))))
            time.sleep(_SAMPLE_S)
    if process.returncode or not samples:
        raise SystemExit("the run failed")
    return samples


def sample(process: psutil.Process) -> tuple[str, float]:
    """Return the name of a process, and its resident memory [MB]."""
    name = f"{process.pid} {' '.join(process.cmdline()).strip()[-40:]}"
    return name, process.memory_info().rss / 2**20


def mean(samples: Sequence[Sizes], name: str, begin: float) -> float:
    """Return the mean size in a twentieth [MB]: between two samples a heap moves by MBs."""
    first = int(begin * len(samples))
    part = samples[first : first + len(samples) // 20 + 1]
    return statistics.fmean(sizes[name] for sizes in part if name in sizes)


def report(folder: Path) -> tuple[float, float]:
    """Make the report of a run in a process of its own; return its time [s] and size [MB]."""
    started = time.monotonic()
    with subprocess.Popen([*STEPBUS, "report", str(folder)]) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit("the report failed")
    return time.monotonic() - started, usage.ru_maxrss / 1024


def soak(steps: int, folder: Path) -> int:
    """Run and report; return 0 when all is as it should be, else 1."""
    missed = []
    samples = run(steps, folder)
    for name in samples[-1]:
        first, last = mean(samples, name, 0.1), mean(samples, name, 0.95)
        print(f"{name:46} {first:7.1f} at 1/10 {last:7.1f} at the end {last - first:+6.2f} MB")
        if abs(last - first) > MOST_GROWTH_MB:
            missed.append(f"{name} is not within {MOST_GROWTH_MB:g} MB of its size at 1/10")
    seconds, size = report(folder)
    print(f"the report: {seconds:.1f} s, at most {size:.0f} MB")
    if seconds > MOST_REPORT_S or size > MOST_REPORT_MB:
        missed.append(f"the report, {MOST_REPORT_S:g} s and {MOST_REPORT_MB:g} MB")
    for text in missed:
        print(f"MISSED: {text}")
    return 1 if missed else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    with tempfile.TemporaryDirectory(prefix="soak-") as scratch:
        sys.exit(soak(parser.parse_args().steps, Path(scratch) / "run"))
