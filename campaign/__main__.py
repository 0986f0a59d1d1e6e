"""`python -m campaign`: strikes runs and sales from outside, judges them, prints tables."""

from __future__ import annotations

import argparse
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from . import runs, store

Cell = int | float | frozenset[int]
"""A count, of which a table has the sum; a measure: the largest; exit codes: all."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What one case came to: what is printed of it, and its row and cells of the table.

    cells: title → cell, beside the number of broken promises.
    """

    case: str
    row: str
    cells: Mapping[str, Cell]
    broken: Sequence[str]
    notes: Sequence[str] = ()


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the lines of a table, a row for each thing that happens; none without an outcome."""
    if not outcomes:
        return []
    rows: dict[str, list[Outcome]] = {}
    for outcome in sorted(outcomes, key=lambda outcome: outcome.row):
        rows.setdefault(outcome.row, []).append(outcome)
    heads = ["What happens", *outcomes[0].cells, "Broken"]
    lines = [heads, ["---"] * len(heads)]
    for name, own in [*rows.items(), ("**all**", outcomes)]:
        columns = zip(*(outcome.cells.values() for outcome in own), strict=True)
        broken = sum(len(outcome.broken) for outcome in own)
        lines.append([name, *map(_total, columns), str(broken)])
    return [f"| {' | '.join(line)} |" for line in lines]


def _total(cells: Sequence[Cell]) -> str:
    if isinstance(cells[0], frozenset):
        codes: frozenset[int] = frozenset().union(*cells)  # type: ignore[arg-type]
        return ", ".join(map(str, sorted(codes)))
    if isinstance(cells[0], float):
        return f"{max(cells):.1f}"
    return str(sum(cells))  # type: ignore[arg-type]


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
        missed = ", missed" if verdict.missed else ""
        yield Outcome(
            case=f"{case}: {verdict.code} after {verdict.seconds:.1f} s{missed}",
            row=case.fault,
            cells={
                "Cases": not verdict.missed,
                "Missed": verdict.missed,
                "Exit codes": frozenset({verdict.code} - {None}),  # type: ignore[arg-type]
                "Slowest end [s]": verdict.seconds,
            },
            broken=verdict.broken,
            notes=notes if verdict.broken else (),
        )


def _sell(options: argparse.Namespace) -> Iterator[Outcome]:
    rows = [
        case
        for case in store.cases(options.sales, options.seed)
        if options.only in case.family and options.on in case.scenario
    ]
    for case, sale in store.sell(rows):
        yield Outcome(
            case=f"{case}: {sale.code} after {sale.seconds:.0f} s",
            row=case.family,
            cells={
                "Cases": 1,
                "Sold": sale.code == 0,
                "Stopped": sale.code != 0,
                "Largest force [N]": sale.force,
                "Too near": bool(sale.excused),
            },
            broken=sale.broken,
            notes=[
                f"{sale.force:.1f} N; {sale.reason}",
                *(f"unavoidable: {line}" for line in sale.excused),
            ],
        )


_PARTS: Mapping[str, Callable[[argparse.Namespace], Iterator[Outcome]]] = {
    "runs": _strike_runs,
    "store": _sell,
}


def _judged(name: str, options: argparse.Namespace) -> list[Outcome]:
    """Run a part, print what each case came to, and return that."""
    outcomes = []
    for number, outcome in enumerate(_PARTS[name](options), start=1):
        outcomes.append(outcome)
        _say(f"{number} {'BROKEN' if outcome.broken else 'ok'} {outcome.case}")
        for line in (*outcome.broken, *outcome.notes):
            _say(f"      {line}")
    return outcomes


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> int:
    """Run the campaign; return 1 when a promise was broken."""
    options, texts, is_good = _arguments(), [], True
    for name in _PARTS if options.part == "all" else [options.part]:
        try:
            outcomes = _judged(name, options)
        except Exception:  # noqa: BLE001  (the other parts are judged, and the tables printed)
            is_good = False
            _say(f"BROKEN: part {name} failed: {traceback.format_exc()}")
        else:
            is_good = is_good and not any(outcome.broken for outcome in outcomes)
            texts.append("\n".join(table(outcomes)) + "\n")
    _say("\n".join(texts))
    if options.table:
        options.table.write_text("\n".join(texts))
    return int(not is_good)


if __name__ == "__main__":
    sys.exit(main())
