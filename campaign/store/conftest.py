"""Tells how many sales were sold, and whether those are enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

import pytest

_AIMS = {"a post": 22 / 24, "somebody": 12 / 16, "undisturbed": 39 / 40}
"""Shares of the sales that are to be sold, by how their families' names begin."""

_COLUMNS = (
    "What happens",
    "Sales",
    "Sold",
    "Median [s]",
    "Of undisturbed",
    "Ran into it",
    "Broken",
)

_rows: list[Mapping[str, Any]] = []


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Keep what a sale has told."""
    told = dict(report.user_properties)
    if report.when == "call" and "family" in told:
        _rows.append({**told, "broken": report.failed})


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail where too few are sold."""
    if _short() and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the table of families, and what is missing."""
    families = dict.fromkeys(row["family"] for row in _rows)
    lines = [_line(_COLUMNS), "|---" * len(_COLUMNS) + "|"] if families else []
    lines += [_line(_cells(name, [r for r in _rows if r["family"] == name])) for name in families]
    for line in [*lines, *_short()]:
        terminalreporter.write_line(line)


def _short() -> list[str]:
    """Return a sentence for each group of which too few were sold; one may always fail."""
    found = []
    for begin, share in _AIMS.items():
        rows = [row for row in _rows if row["family"].startswith(begin)]
        sold, least = sum(row["sold"] for row in rows), min(share * len(rows), len(rows) - 1)
        if sold < least - 1e-9:
            found.append(f"{begin}: {sold} of {len(rows)} are sold, not {least:.0f}")
    return found


def _cells(name: str, rows: Sequence[Mapping[str, Any]]) -> list[object]:
    times, shares = (
        [row[key] for row in rows if row.get(key)] for key in ("seconds", "of undisturbed")
    )
    return [
        name,
        len(rows),
        sum(row["sold"] for row in rows),
        f"{median(times):.1f}" if times else "",
        f"{median(shares):.2f}, at most {max(shares):.2f}" if shares else "",
        sum(row["hit"] for row in rows),
        sum(row["broken"] for row in rows),
    ]


def _line(cells: Sequence[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"
