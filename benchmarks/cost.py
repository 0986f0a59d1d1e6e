"""What a change costs a step: two checkouts, one round each in turn.

`python benchmarks/cost.py BEFORE AFTER [--rounds N] [--steps N]`, both folders with a `.venv`. Each
round runs two_link once per checkout and window, with recording on, in alternating order, so that
a noisy machine hurts all alike. Shown are medians: steps per second of the lockstep, and processor
time (user and system) per step of all processes, the orchestrator's included. A run of a few steps
is subtracted from the latter, for the start-up.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table

STEPS = 4000
FEW_STEPS = 100
STEP_MS = 5
WINDOWS = (1, 64)


@dataclass
class Case:
    """One checkout at one window. rates: steps/s. costs: processor time per step [µs]."""

    name: str
    folder: Path
    window: int
    rates: list[float] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)

    def measure(self, steps: int) -> None:
        """Run once with many steps and once with few."""
        rate, cpu_s = self._run(steps)
        _, start_up_s = self._run(FEW_STEPS)
        self.rates.append(rate)
        self.costs.append(1e6 * (cpu_s - start_up_s) / (steps - FEW_STEPS))

    def _run(self, steps: int) -> tuple[float, float]:
        """Return steps per second, and the processor time of all processes [s]."""
        with tempfile.TemporaryDirectory(prefix="cost-") as folder:
            command = [
                *(str(self.folder / ".venv" / "bin" / "stepbus"), "run", "two_link", "--json"),
                *("--no-report", "--out", f"{folder}/run", "--window", str(self.window)),
                *("--set", f"duration={steps * STEP_MS}ms"),
            ]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
                text = process.stdout.read() if process.stdout is not None else ""
                # Its own time and that of all it has waited for: every participant.
                _, status, usage = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{' '.join(command)}\nended with {process.returncode}: {text}")
        result = json.loads(text)
        return result["steps"] / result["wall_s"], usage.ru_utime + usage.ru_stime


def show(cases: list[Case], rounds: int, steps: int) -> None:
    """Print medians, and the ratios of the second checkout to the first."""
    table = Table(title=f"two_link, {steps} steps, medians of {rounds} rounds")
    table.add_column("window", justify="right")
    table.add_column("checkout")
    for head in ("steps/s", "ratio", "processor time a step [µs]", "ratio"):
        table.add_column(head, justify="right")
    for window in WINDOWS:
        before, after = (case for case in cases if case.window == window)
        for case in (before, after):
            rate, cost = statistics.median(case.rates), statistics.median(case.costs)
            ratios = (
                rate / statistics.median(before.rates),
                cost / statistics.median(before.costs),
            )
            shown = ["", ""] if case is before else [f"{ratio:.2f}" for ratio in ratios]
            row = (f"{rate:.0f}", shown[0], f"{cost:.0f}", shown[1])
            table.add_row(str(window), case.name, *row)
    Console(width=100).print(table)


def main() -> None:
    """Read the arguments and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--steps", type=int, default=STEPS)
    args = parser.parse_args()
    cases = [
        Case(name=name, folder=folder.resolve(), window=window)
        for window in WINDOWS
        for name, folder in (("before", args.before), ("after", args.after))
    ]
    for number in range(args.rounds):
        for case in cases if number % 2 == 0 else reversed(cases):
            case.measure(args.steps)
        newest = (f"{c.name} {c.window}: {c.rates[-1]:.0f}/s {c.costs[-1]:.0f} µs" for c in cases)
        sys.stderr.write(f"round {number + 1} of {args.rounds}: {', '.join(newest)}\n")
    show(cases, args.rounds, args.steps)


if __name__ == "__main__":
    main()
