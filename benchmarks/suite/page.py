"""The table of docs/performance.md."""

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scripts.pages import filled

from stepbus_schemas.tables import table

from .cases import CHAIN

_HEAD = [
    *("Case", "steps/s", "of the chain", "processor time a step [µs]", "of the chain"),
    *("wake-ups a step", "p50 [µs]", "p99 [µs]", "max [ms]", "recorded [B/step]"),
    "memory of each process [MB]",
]

Row = dict[str, Any]


def write_page(page: Path, names: Sequence[str], rows: Sequence[Row]) -> None:
    """Write the table into the page; names: of the cases, in order."""
    good = [row for row in rows if "failed" not in row]
    cases = {name: [row for row in good if row["case"] == name] for name in names}
    cases = {name: measured for name, measured in cases.items() if measured}
    lines = [_line(name, measured, cases.get(CHAIN, [])) for name, measured in cases.items()]
    missing = sorted(set(names) - set(cases))
    content = f"{_machine(good)}\n\n{table(_HEAD, lines)}"
    if missing:
        content += f"\nNot measured: {', '.join(missing)}.\n"
    page.write_text(filled(page.read_text(), {"bench": content}))


def _median(rows: Sequence[Row], key: str) -> float:
    return statistics.median([float(row[key]) for row in rows])


def ratio(rows: Sequence[Row], base: Sequence[Row], key: str) -> float | None:
    """Return the median of the ratios within the same rounds; None without a common round."""
    of_round = {row["round"]: row[key] for row in base}
    ratios = [row[key] / of_round[row["round"]] for row in rows if of_round.get(row["round"])]
    return statistics.median(ratios) if ratios else None


def _line(name: str, rows: Sequence[Row], base: Sequence[Row]) -> list[str]:
    ratios = (ratio(rows, base, key) for key in ("rate", "cpu_us"))
    of_rate, of_cpu = ("" if value is None else f"{value:.2f}" for value in ratios)
    recorded = f"{_median(rows, 'bytes'):.0f}" if "bytes" in rows[0] else ""
    memory = " ".join(f"{size:.0f}" for size in rows[-1].get("memory", ()))
    return [
        name,
        f"{_median(rows, 'rate'):.0f}",
        of_rate,
        f"{_median(rows, 'cpu_us'):.0f}",
        of_cpu,
        f"{_median(rows, 'wake_ups'):.1f}",
        f"{_median(rows, 'p50'):.0f}",
        f"{_median(rows, 'p99'):.0f}",
        f"{_median(rows, 'max') * 1e-3:.1f}",
        recorded,
        memory,
    ]


def _machine(rows: Sequence[Row]) -> str:
    loads = [row["load"] for row in rows]
    rounds = len({row["round"] for row in rows})
    return (
        f"Medians of {rounds} interleaved rounds; ratios are those within a round. "
        f"{rows[-1]['machine']}; load {min(loads):.1f} to {max(loads):.1f}."
    )
