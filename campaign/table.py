"""The tables that the campaign prints, in Markdown."""

from __future__ import annotations

import contextlib
import platform
import sys
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from .faults.catalogue import GROUPS
from .judge import Verdict
from .recordings import Outcome
from .runs import Case
from .store import Case as SaleCase
from .store import Outcome as SaleOutcome


@dataclass
class RunTable:
    """What the runs came to: for each type of fault the cases, broken promises, codes, times.

    cases: those in which the fault struck. missed: those whose run had ended before.
    """

    cases: Counter[str] = field(default_factory=Counter)
    missed: Counter[str] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)
    codes: defaultdict[str, set[int]] = field(default_factory=lambda: defaultdict(set))
    slowest: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))

    def add(self, case: Case, verdict: Verdict) -> None:
        """Count one case."""
        name = case.fault
        self.cases[name] += not verdict.missed
        self.missed[name] += verdict.missed
        self.broken[name] += bool(verdict.broken)
        self.slowest[name] = max(self.slowest[name], verdict.seconds)
        if verdict.code is not None:
            self.codes[name].add(verdict.code)

    def lines(self) -> list[str]:
        """Return the table."""
        lines = [
            "| Strikes | Fault | Cases | Missed | Exit codes | Slowest end [s] | Broken |",
            "|---|---|---|---|---|---|---|",
        ]
        for group, faults in GROUPS.items():
            for name in faults:
                if name in self.cases:
                    codes = ", ".join(map(str, sorted(self.codes[name])))
                    lines.append(
                        f"| {group} | {name} | {self.cases[name]} | {self.missed[name]} | {codes} "
                        f"| {self.slowest[name]:.1f} | {self.broken[name]} |"
                    )
        totals = f"{self.cases.total()} | {self.missed.total()} | | | {self.broken.total()}"
        return [*lines, f"| **all** | | {totals} |"] if self.cases else []


@dataclass
class RecordingTable:
    """What the mutated recordings came to: for each mutation the files, calls, broken promises."""

    files: Counter[str] = field(default_factory=Counter)
    calls: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)

    def add(self, outcome: Outcome) -> None:
        """Count one file."""
        self.files[outcome.mutation] += 1
        self.calls[outcome.mutation] += outcome.calls
        self.refused[outcome.mutation] += outcome.reported
        self.broken[outcome.mutation] += len(outcome.broken)

    def lines(self) -> list[str]:
        """Return the table."""
        lines = [
            "| Mutation | Recordings | Calls | Damage reported | Broken |",
            "|---|---|---|---|---|",
        ]
        for name in self.files:
            counts = (self.files[name], self.calls[name], self.refused[name], self.broken[name])
            lines.append(f"| {name} | {' | '.join(map(str, counts))} |")
        totals = (self.files, self.calls, self.refused, self.broken)
        total = " | ".join(str(count.total()) for count in totals)
        return [*lines, f"| **all** | {total} |"] if self.files else []


@dataclass
class SaleTable:
    """What the sales came to: for each family the cases, sales, largest force, broken promises.

    excused: sales in which something appeared nearer than the robot can stop.
    """

    cases: Counter[str] = field(default_factory=Counter)
    sold: Counter[str] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)
    excused: Counter[str] = field(default_factory=Counter)
    force: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))

    def add(self, case: SaleCase, outcome: SaleOutcome) -> None:
        """Count one sale."""
        self.cases[case.family] += 1
        self.sold[case.family] += outcome.code == 0
        self.broken[case.family] += bool(outcome.broken)
        self.excused[case.family] += bool(outcome.excused)
        self.force[case.family] = max(self.force[case.family], outcome.force)

    def lines(self) -> list[str]:
        """Return the table."""
        lines = [
            "| What happens | Cases | Sold | Stopped | Largest force [N] | Too near | Broken |",
            "|---|---|---|---|---|---|---|",
        ]
        for name, count in self.cases.items():
            sold, broken = self.sold[name], self.broken[name]
            row = f"| {name} | {count} | {sold} | {count - sold} | {self.force[name]:.1f} |"
            lines.append(f"{row} {self.excused[name]} | {broken} |")
        total, sold, near = self.cases.total(), self.sold.total(), self.excused.total()
        last = f"| **all** | {total} | {sold} | {total - sold} | | {near} | {self.broken.total()} |"
        return [*lines, last] if total else []


def heading(arguments: list[str], seconds: float, versions: Mapping[str, str]) -> str:
    """Return how, when and on what a campaign ran."""
    command = " ".join(["python -m campaign", *arguments])
    named = [f"{name} {number}" for name, number in versions.items()]
    return (
        f"`{command}`: {datetime.now(UTC):%Y-%m-%d}, {seconds / 60:.0f} min on {_machine()}, "
        f"{sys.platform}, Python {platform.python_version()}, {', '.join(named)}"
    )


def _machine() -> str:
    """Return the processors, as far as the system names them."""
    names: list[str] = []
    with contextlib.suppress(OSError):
        rows = Path("/proc/cpuinfo").read_text().splitlines()
        names = [row.partition(":")[2].strip() for row in rows if row.startswith("model name")]
    return f"{len(names) or 'several'} × {names[0] if names else platform.processor()}"
