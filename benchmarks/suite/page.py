"""The table of docs/performance.md, between two marks of that page."""

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .cases import CHAIN

START, END = "<!-- bench: start -->", "<!-- bench: end -->"
_HEAD = """| Case | steps/s | of the chain | processor time a step [µs] | of the chain | wake-ups a step | p50 [µs] | p99 [µs] | max [ms] | recorded [B/step] | memory of each process [MB] |
|---|---|---|---|---|---|---|---|---|---|---|
"""  # noqa: E501

Row = dict[str, Any]


def write_page(page: Path, names: Sequence[str], rows: Sequence[Row]) -> None:
    """Replace what stands between the marks; names: of the cases, in order."""
    good = [row for row in rows if "failed" not in row]
    cases = {name: [row for row in good if row["case"] == name] for name in names}
    cases = {name: measured for name, measured in cases.items() if measured}
    lines = [_line(name, measured, cases.get(CHAIN, [])) for name, measured in cases.items()]
    missing = sorted(set(names) - set(cases))
    content = f"{_machine(good)}\n\n{_HEAD}{''.join(lines)}\n"
    if missing:
        content += f"Not measured: {', '.join(missing)}.\n\n"
    text = page.read_text()
    before, _, rest = text.partition(START)
    _, _, after = rest.partition(END)
    page.write_text(f"{before}{START}\n{content}{END}{after}")


def _median(rows: Sequence[Row], key: str) -> float:
    return statistics.median([float(row[key]) for row in rows])


def ratio(rows: Sequence[Row], base: Sequence[Row], key: str) -> float | None:
    """Return the median of the ratios within the same rounds; None without a common round."""
    of_round = {row["round"]: row[key] for row in base}
    ratios = [row[key] / of_round[row["round"]] for row in rows if of_round.get(row["round"])]
    return statistics.median(ratios) if ratios else None


def _line(name: str, rows: Sequence[Row], base: Sequence[Row]) -> str:
    ratios = (ratio(rows, base, key) for key in ("rate", "cpu_us"))
    of_rate, of_cpu = ("" if value is None else f"{value:.2f}" for value in ratios)
    recorded = f"{_median(rows, 'bytes'):.0f}" if "bytes" in rows[0] else ""
    memory = " ".join(f"{size:.0f}" for size in rows[-1].get("memory", ()))
    cells = (
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
    )
    return f"| {' | '.join(cells)} |\n"


def _machine(rows: Sequence[Row]) -> str:
    loads = [row["load"] for row in rows]
    rounds = len({row["round"] for row in rows})
    return (
        f"Medians of {rounds} interleaved rounds; ratios are those within a round. "
        f"{rows[-1]['machine']}; load {min(loads):.1f} to {max(loads):.1f}."
    )
