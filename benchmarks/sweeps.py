"""How many runs a minute `stepbus sweep` makes, on 1 and 2 cores, beside calls of `stepbus run`.

    python -m benchmarks.sweeps [--runs 1000] [--calls 20] [--duration 10s] [--rounds 1]

Prints runs/min of each, their ratios, and the memory of the sweep's own process at a quarter of
its runs and at the end. Start-up of Ray is part of a sweep's time.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]


def sweep(runs: int, jobs: int, duration: str, folder: Path) -> tuple[float, list[float]]:
    """Return runs/min of a sweep, and its memory [MB] at a quarter of it and at the end."""
    words = ["two_link", "--set", f"duration={duration}", "--keep", "none", "--json"]
    axis = ["--vary", f"controller.params.kp=50:200:{runs}"]
    command = [*STEPBUS, "sweep", *words, *axis, "--jobs", str(jobs), "--out", str(folder)]
    began, memory = time.monotonic(), [0.0, 0.0]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        journal = folder / "rows.jsonl"
        while process.poll() is None:
            time.sleep(0.5)
            done = journal.read_bytes().count(b"\n") if journal.exists() else 0
            if done <= runs // 4:
                memory[0] = _memory_mb(process.pid) or memory[0]
            memory[1] = _memory_mb(process.pid) or memory[1]
    if process.returncode:
        raise SystemExit(f"the sweep ended with exit code {process.returncode}")
    return 60 * runs / (time.monotonic() - began), memory


def _memory_mb(pid: int) -> float:
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def calls(count: int, duration: str, folder: Path) -> float:
    """Return runs/min of calls of `stepbus run`, one after the other."""
    began = time.monotonic()
    for number in range(count):
        kp = 50 + 150 * number / max(1, count - 1)
        words = ["two_link", "--set", f"duration={duration}", "--set", f"controller.params.kp={kp}"]
        out = ["--out", str(folder / str(number)), "--json"]
        subprocess.run([*STEPBUS, "run", *words, *out], check=True, stdout=subprocess.DEVNULL)
    return 60 * count / (time.monotonic() - began)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--calls", type=int, default=20)
    parser.add_argument("--duration", default="10s")
    parser.add_argument("--rounds", type=int, default=1)
    args = parser.parse_args()
    for number in range(args.rounds):
        with tempfile.TemporaryDirectory(prefix="sweeps-") as name:
            folder = Path(name)
            rates = {}
            for jobs in (1, 2):
                rates[jobs], memory = sweep(args.runs, jobs, args.duration, folder / f"{jobs}")
                print(
                    f"round {number}: {args.runs} runs of {args.duration} on {jobs} cores: "
                    f"{rates[jobs]:.1f} runs/min, memory {memory[0]:.0f} then {memory[1]:.0f} MB",
                    flush=True,
                )
            tables = {(folder / f"{jobs}/results.parquet").read_bytes() for jobs in (1, 2)}
            alone = calls(args.calls, args.duration, folder / "calls")
        print(
            f"round {number}: calls of `stepbus run`: {alone:.1f} runs/min; 2 cores make "
            f"{rates[2] / rates[1]:.2f} times as many as 1, and {rates[2] / alone:.1f} times as "
            f"many as calls; the tables are {'the same' if len(tables) == 1 else 'DIFFERENT'}",
            flush=True,
        )


if __name__ == "__main__":
    main()
