"""A long run: no process grows, and its report takes little time and memory.

`python benchmarks/soak.py [--steps N] [--out FOLDER]` runs two_link with recording on and samples
the memory of every process. It passes if the resident memory of each, and what is no file in it,
are at the end within 1 MB of what they were at a tenth of the run (means over a twentieth), and if
the report of the recording, made by a process of its own, takes less than 20 s and 300 MB.

What a process shares with others (PSS, USS) changes when other runs on the machine start and end.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from stepbus_orchestrator.run.reports import Observer, Progress
from stepbus_orchestrator.run.result import Result
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

STEPS = 1_000_000
STEP_MS = 5
SETTLED, END = (0.1, 0.15), (0.95, 1.0)
"""Parts of the run whose mean sizes are compared: between two samples a heap moves by MBs."""
MOST_GROWTH_MB = 1.0
MOST_REPORT_S = 20.0
MOST_REPORT_MB = 300.0

_SAMPLE_S = 2.0
_SHOW_S = 30.0
_KB_PER_MB = 1024.0
_REPORT = """
import sys
from pathlib import Path
from stepbus_tools.report import write_report
print(*write_report(Path(sys.argv[1])), sep="\\n")
"""


@dataclass(frozen=True, kw_only=True)
class Size:
    """The memory of one process [MB].

    rss: resident. pss: resident, pages that others have too by its share. own: what is no file.
    """

    rss: float
    pss: float
    own: float


class Mean:
    """The mean of sizes; it holds no samples, since this process is the orchestrator."""

    def __init__(self) -> None:
        self._sums = (0.0, 0.0, 0.0)
        self._count = 0

    def take(self, size: Size) -> None:
        """Add a sample."""
        rss, pss, own = self._sums
        self._sums = (rss + size.rss, pss + size.pss, own + size.own)
        self._count += 1

    def size(self) -> Size:
        """Return the mean."""
        rss, pss, own = (total / self._count for total in self._sums)
        return Size(rss=rss, pss=pss, own=own)


def size_of(pid: int) -> Size:
    """Return the memory of a process; raises OSError when it has ended."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    rows = {key: int(kb) / _KB_PER_MB for key, kb in re.findall(r"(\w+): +(\d+) kB", text)}
    return Size(rss=rows["Rss"], pss=rows["Pss"], own=rows["Anonymous"])


def processes() -> dict[str, int]:
    """Return name → process id of this process, which is the orchestrator, and its children."""
    pids = {"orchestrator": os.getpid()}
    for child in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split():
        words = Path(f"/proc/{child}/cmdline").read_bytes().decode().split("\0")
        module = next((w for w in words if w.startswith("stepbus_") or w.endswith(".py")), words[0])
        pids[Path(module).stem.removeprefix("stepbus_")] = int(child)
    return pids


class Sampler(Observer):
    """An observer of a run that samples the memory of its processes.

    settled, end: name → mean size, after a tenth of the run and at its end.
    """

    def __init__(self, steps: int) -> None:
        self.settled: dict[str, Mean] = {}
        self.end: dict[str, Mean] = {}
        self._steps = steps
        self._sampled_at = self._shown_at = 0.0

    def progress(self, progress: Progress) -> None:
        """Sample every two seconds."""
        now = time.monotonic()
        if progress.phase != "stepping" or now - self._sampled_at < _SAMPLE_S:
            return
        self._sampled_at = now
        sizes = {name: size_of(pid) for name, pid in processes().items()}
        for (begin, end), means in ((SETTLED, self.settled), (END, self.end)):
            if begin <= progress.step / self._steps <= end:
                for name, size in sizes.items():
                    means.setdefault(name, Mean()).take(size)
        if now - self._shown_at > _SHOW_S:
            self._shown_at = now
            shown = ", ".join(f"{name} {size.rss:.2f}" for name, size in sizes.items())
            sys.stderr.write(f"step {progress.step}: resident [MB]: {shown}\n")

    def event(self, level: str, who: str, step: int, text: str) -> None:
        """Show it."""
        sys.stderr.write(f"step {step}: {level}: {who}: {text}\n")


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a report took: by the wall clock and on processors [s], and at most [MB]."""

    wall_s: float
    cpu_s: float
    peak: float
    text: str


def report(recording: Path) -> Report:
    """Make the report of a recording in a process of its own."""
    started = time.monotonic()
    command = [sys.executable, "-c", _REPORT, str(recording)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        text = process.stdout.read() if process.stdout is not None else ""
        _, code, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(code)
    if process.returncode:
        raise SystemExit("the report failed")
    return Report(
        wall_s=time.monotonic() - started,
        cpu_s=usage.ru_utime + usage.ru_stime,
        peak=usage.ru_maxrss / _KB_PER_MB,
        text=text,
    )


def show(sampler: Sampler, result: Result) -> bool:
    """Print the sizes; return whether no process has grown too much."""
    table = Table(title=f"{result.steps} steps, {result.steps / result.wall_s:.0f} steps/s")
    table.add_column("memory [MB]")
    heads = (f"{unit} {when}" for when in ("at 1/10", "at end") for unit in ("RSS", "PSS", "own"))
    for head in (*heads, "RSS grown", "own grown"):
        table.add_column(head, justify="right")
    is_flat = True
    for name, mean in sampler.end.items():
        first, last = sampler.settled[name].size(), mean.size()
        grown = (last.rss - first.rss, last.own - first.own)
        cells = (first.rss, first.pss, first.own, last.rss, last.pss, last.own)
        texts = [*(f"{cell:.1f}" for cell in cells), *(f"{growth:+.2f}" for growth in grown)]
        table.add_row(name, *texts)
        is_flat = is_flat and all(abs(growth) <= MOST_GROWTH_MB for growth in grown)
    Console(width=120).print(table)
    return is_flat


def soak(steps: int, folder: Path) -> int:
    """Run and report; return 0 when all is as it should be, else 1."""
    sampler = Sampler(steps)
    scenario = load("two_link", [f"duration={steps * STEP_MS}ms"])
    result = run(scenario, Options(out=folder), sampler)
    if result.exit_code or not sampler.settled or not sampler.end:
        print(result.reason if result.exit_code else "the run was too short to sample")
        return 1
    is_flat = show(sampler, result)
    megabytes = result.recording.stat().st_size / 1e6
    made = report(result.recording)
    print(
        f"report of {megabytes:.0f} MB: {made.wall_s:.1f} s, {made.cpu_s:.1f} s of processor time,"
    )
    print(f"at most {made.peak:.0f} MB\n{made.text}", end="")
    if not is_flat:
        print(f"MISSED: a process is not within {MOST_GROWTH_MB:g} MB of its size at 1/10")
    if made.wall_s > MOST_REPORT_S or made.peak > MOST_REPORT_MB:
        print(f"MISSED: the report, {MOST_REPORT_S:g} s and {MOST_REPORT_MB:g} MB")
        return 1
    return 0 if is_flat else 1


def main() -> int:
    """Read the arguments and soak."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--out", type=Path, help="keep the run in this folder")
    args = parser.parse_args()
    if args.out is not None:
        return soak(args.steps, args.out)
    folder = Path(tempfile.mkdtemp(prefix="soak-"))
    try:
        return soak(args.steps, folder / "run")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
