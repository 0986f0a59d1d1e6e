"""`python -m campaign`: strikes runs and sales from outside, judges them, prints tables."""

from __future__ import annotations

import argparse
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from . import runs, store

Column = Callable[[Sequence[Any]], object]
"""Makes a cell of what all cases of a row have there."""


def codes(values: Sequence[int | None]) -> str:
    """Return exit codes, without that of a run that hangs."""
    return ", ".join(str(code) for code in sorted({*values} - {None}))  # type: ignore[type-var]


def most(values: Sequence[float]) -> str:
    """Return the largest value."""
    return f"{max(values):.1f}"


RUNS: Mapping[str, Column] = {
    "Cases": sum, "Missed": sum, "Exit codes": codes, "Slowest end [s]": most, "Broken": sum,
}  # fmt: skip
"""Cases: those in which the fault struck. Missed: those whose run had ended before."""

SALES: Mapping[str, Column] = {
    "Cases": len, "Sold": sum, "Stopped": sum, "Largest force [N]": most, "Too near": sum,
    "Broken": sum,
}  # fmt: skip
"""Too near: sales in which something appeared nearer than the robot can stop."""


class Table:
    """What the cases came to, a row for each thing that happens; the last column: broken promises.

    columns: title → what makes its cells.
    """

    def __init__(self, columns: Mapping[str, Column]) -> None:
        self._columns = columns
        self._rows: dict[str, list[Sequence[Any]]] = {}
        self.broken = 0

    def add(self, name: str, *values: Any) -> None:
        """Count one case: a value for each column."""
        self._rows.setdefault(name, []).append(values)
        self.broken += values[-1]

    def lines(self) -> list[str]:
        """Return the table; empty without a case."""
        if not self._rows:
            return []
        every = [case for cases in self._rows.values() for case in cases]
        rows = [self._row(name, cases) for name, cases in sorted(self._rows.items())]
        heads = ["What happens", *self._columns]
        table = [heads, ["---"] * len(heads), *rows, self._row("**all**", every)]
        return [f"| {' | '.join(row)} |" for row in table]

    def _row(self, name: str, cases: Sequence[Sequence[Any]]) -> list[str]:
        columns = zip(self._columns.values(), zip(*cases, strict=True), strict=True)
        return [name, *(str(make(values)) for make, values in columns)]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What one case came to: what is printed of it, and its row and cells of the table."""

    case: str
    row: str
    cells: Sequence[Any]
    broken: Sequence[str]
    notes: Sequence[str] = field(default=())


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m campaign", description=__doc__)
    parser.add_argument("--part", choices=["all", *_PARTS], default="all")
    parser.add_argument(
        "--count", type=int, default=runs.WHOLE, help=f"number of runs (default: {runs.WHOLE})"
    )
    parser.add_argument("--sales", type=int, default=64, help="number of sales (default: 64)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="only faults whose name contains this")
    parser.add_argument("--on", default="", help="only scenarios whose name contains this")
    parser.add_argument(
        "--patience",
        type=float,
        default=1.0,
        help="factor for all deadlines of the runs; above 1, only a run that hangs for two "
        "minutes is late, so that a slow machine does not matter (default: 1)",
    )
    parser.add_argument("--table", type=Path, help="write the tables to this file, in Markdown")
    return parser.parse_args()


def _strike_runs(options: argparse.Namespace) -> Iterator[Outcome]:
    rows = [
        case
        for case in runs.cases(options.count, options.seed)
        if options.only in case.fault and options.on in case.scenario
    ]
    for case, verdict in runs.strike(rows, options.seed, options.patience):
        notes = [f"reason: {verdict.said}", f"output: {verdict.output[-400:]!r}"]
        missed = verdict.missed
        yield Outcome(
            case=f"{case}: {verdict.code} after {verdict.seconds:.1f} s{', missed' * missed}",
            row=case.fault,
            cells=(not missed, missed, verdict.code, verdict.seconds),
            broken=verdict.broken,
            notes=notes if verdict.broken else (),
        )


def _sell(options: argparse.Namespace) -> Iterator[Outcome]:
    rows = [
        case
        for case in store.cases(options.sales, options.seed)
        if options.only in case.family and options.on in case.scenario
    ]
    for case, outcome in store.sell(rows):
        is_sold = outcome.code == 0
        yield Outcome(
            case=f"{case}: {outcome.code} after {outcome.seconds:.0f} s",
            row=case.family,
            cells=(1, is_sold, not is_sold, outcome.force, bool(outcome.excused)),
            broken=outcome.broken,
            notes=[
                f"{outcome.force:.1f} N; {outcome.reason}",
                *(f"unavoidable: {line}" for line in outcome.excused),
            ],
        )


_PARTS: Mapping[
    str, tuple[Callable[[argparse.Namespace], Iterator[Outcome]], Mapping[str, Column]]
] = {
    "runs": (_strike_runs, RUNS),
    "store": (_sell, SALES),
}


def _judged(name: str, options: argparse.Namespace) -> Table:
    """Run a part, print what each case came to, and return its table."""
    outcomes, columns = _PARTS[name]
    table = Table(columns)
    for number, outcome in enumerate(outcomes(options), start=1):
        table.add(outcome.row, *outcome.cells, len(outcome.broken))
        _say(f"{number} {'BROKEN' if outcome.broken else 'ok'} {outcome.case}")
        for line in (*outcome.broken, *outcome.notes):
            _say(f"      {line}")
    return table


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> int:
    """Run the campaign; return 1 when a promise was broken."""
    options, texts, is_good = _arguments(), [], True
    for name in _PARTS if options.part == "all" else [options.part]:
        try:
            table = _judged(name, options)
        except Exception:  # noqa: BLE001  (the other parts are judged, and the tables printed)
            is_good = False
            _say(f"BROKEN: part {name} failed: {traceback.format_exc()}")
        else:
            is_good = is_good and not table.broken
            texts.append("\n".join(table.lines()) + "\n")
    _say("\n".join(texts))
    if options.table:
        options.table.write_text("\n".join(texts))
    return int(not is_good)


if __name__ == "__main__":
    sys.exit(main())
