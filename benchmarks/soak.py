"""A long run: no process grows, and its report takes little time and memory.

`python benchmarks/soak.py [--steps N]` runs two_link with recording on and samples the memory of
every process. It passes if the resident memory of each is at the end within 1 MB of what it was at
a tenth of the run (means over a twentieth), and if the report, made by a process of its own, takes
less than 20 s and 300 MB.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from stepbus_orchestrator.run.reports import Observer, Progress
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

STEP_MS = 5
SETTLED, END = (0.1, 0.15), (0.95, 1.0)
"""Parts of the run whose mean sizes are compared: between two samples a heap moves by MBs."""
MOST_GROWTH_MB = 1.0
MOST_REPORT_S = 20.0
MOST_REPORT_MB = 300.0
_SAMPLE_S = 2.0


class Sampler(Observer):
    """An observer of a run that samples the memory of its processes.

    sums: part of the run → process → sum and number of its samples [MB]. It keeps no samples, since
    this process is the orchestrator.
    """

    def __init__(self, steps: int) -> None:
        self.sums: dict[tuple[float, float], dict[str, tuple[float, int]]] = {SETTLED: {}, END: {}}
        self._steps = steps
        self._sampled_at = 0.0

    def progress(self, progress: Progress) -> None:
        """Sample every two seconds."""
        now = time.monotonic()
        if progress.phase != "stepping" or now - self._sampled_at < _SAMPLE_S:
            return
        self._sampled_at = now
        own = psutil.Process()
        for (begin, end), sums in self.sums.items():
            if begin <= progress.step / self._steps <= end:
                for process in (own, *own.children(recursive=True)):
                    name = f"{process.pid} {' '.join(process.cmdline()).strip()[-40:]}"
                    total, count = sums.get(name, (0.0, 0))
                    sums[name] = (total + process.memory_info().rss / 2**20, count + 1)

    def mean(self, part: tuple[float, float], name: str) -> float:
        """Return the mean size of a process in a part of the run [MB]."""
        total, count = self.sums[part].get(name, (0.0, 1))
        return total / count


def report(recording: Path) -> tuple[float, float]:
    """Make the report of a recording in a process of its own; return its time [s] and size [MB]."""
    started = time.monotonic()
    command = [sys.executable, "-m", "stepbus_orchestrator.cli", "report", str(recording)]
    with subprocess.Popen(command) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit("the report failed")
    return time.monotonic() - started, usage.ru_maxrss / 1024


def soak(steps: int, folder: Path) -> int:
    """Run and report; return 0 when all is as it should be, else 1."""
    sampler = Sampler(steps)
    result = run(load("two_link", [f"duration={steps * STEP_MS}ms"]), Options(out=folder), sampler)
    if result.exit_code or not sampler.sums[END]:
        print(result.reason if result.exit_code else "the run was too short to sample")
        return 1
    print(f"{result.steps} steps, {result.steps / result.wall_s:.0f} steps/s; memory [MB]:")
    missed = []
    for name in sampler.sums[END]:
        first, last = sampler.mean(SETTLED, name), sampler.mean(END, name)
        print(f"{name:46} {first:7.1f} at 1/10 {last:7.1f} at the end {last - first:+6.2f}")
        if abs(last - first) > MOST_GROWTH_MB:
            missed.append(f"{name} is not within {MOST_GROWTH_MB:g} MB of its size at 1/10")
    seconds, size = report(result.recording)
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
