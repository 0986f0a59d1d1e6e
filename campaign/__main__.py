"""`python -m campaign`: strikes runs and recordings from outside, judges them, prints tables."""

from __future__ import annotations

import argparse
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from . import recordings, runs, store
from .table import RecordingTable, RunTable, SaleTable, heading


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m campaign", description=__doc__)
    parser.add_argument("--part", choices=["all", *_PARTS], default="all")
    parser.add_argument(
        "--count", type=int, default=runs.WHOLE, help=f"number of runs (default: {runs.WHOLE})"
    )
    parser.add_argument("--first", type=int, default=0, help="number of the first run (default: 0)")
    parser.add_argument(
        "--mutations", type=int, default=2000, help="number of mutated recordings (default: 2000)"
    )
    parser.add_argument("--sales", type=int, default=64, help="number of sales (default: 64)")
    parser.add_argument("--keep", type=Path, help="folder for the sales that broke a guarantee")
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
    parser.add_argument(
        "--minutes", type=float, default=1e9, help="start no further case of a part after this time"
    )
    parser.add_argument("--table", type=Path, help="write the tables to this file, in Markdown")
    return parser.parse_args()


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _strike_runs(options: argparse.Namespace, give_up: float) -> RunTable:
    rows = [
        case
        for case in runs.cases(options.count, options.seed)
        if options.only in case.fault
        and options.on in case.scenario
        and case.number >= options.first
    ]
    table, outcomes = RunTable(), runs.strike(rows, options.seed, options.patience)
    for number, (case, verdict) in enumerate(outcomes, start=1):
        table.add(case, verdict)
        state = "BROKEN" if verdict.broken else "MISSED" if verdict.missed else "ok"
        _say(f"{number}/{len(rows)} {state} {case}: {verdict.code} after {verdict.seconds:.1f} s")
        if verdict.broken:
            details = [*verdict.broken, f"reason: {verdict.said}"]
            details.append(f"output: {verdict.output[-400:]!r}")
            _say("\n".join(f"      {line}" for line in details))
        if time.monotonic() > give_up:
            break
    return table


def _mutate_recordings(options: argparse.Namespace, give_up: float) -> RecordingTable:
    table = RecordingTable()
    outcomes = recordings.mutate(options.mutations, options.seed)
    for number, outcome in enumerate(outcomes, start=1):
        table.add(outcome)
        for line in outcome.broken:
            _say(f"#{outcome.number} {outcome.mutation} of {outcome.source}: {line}")
        if number % 50 == 0:
            _say(f"{number}/{options.mutations} recordings, {table.broken.total()} broken")
        if time.monotonic() > give_up:
            break
    return table


def _sell(options: argparse.Namespace, give_up: float) -> SaleTable:
    rows = [
        case
        for case in store.cases(options.sales, options.seed)
        if options.only in case.family
        and options.on in case.scenario
        and case.number >= options.first
    ]
    table = SaleTable()
    for number, (case, outcome) in enumerate(store.sell(rows, options.keep), start=1):
        table.add(case, outcome)
        state = "BROKEN" if outcome.broken else "ok"
        _say(f"{number}/{len(rows)} {state} {case}: {outcome.code} after {outcome.seconds:.0f} s")
        _say(f"      {outcome.force:.1f} N; {outcome.reason}")
        for line in outcome.excused:
            _say(f"      unavoidable: {line}")
        for line in outcome.broken:
            _say(f"      broken: {line}")
        if time.monotonic() > give_up:
            break
    return table


_PARTS: Mapping[str, Callable[[argparse.Namespace, float], Any]] = {
    "runs": _strike_runs,
    "recordings": _mutate_recordings,
    "store": _sell,
}


def main() -> int:
    """Run the campaign; return 1 when a promise was broken."""
    options, began = _arguments(), time.monotonic()
    tables: list[RunTable | RecordingTable | SaleTable] = []
    is_whole = True
    for name, part in _PARTS.items():
        try:
            if options.part in {"all", name}:
                tables.append(part(options, time.monotonic() + 60 * options.minutes))
        except Exception:  # noqa: BLE001  (the other parts are judged, and the tables printed)
            is_whole = False
            _say(f"BROKEN: part {name} failed: {traceback.format_exc()}")
    versions = {name: version(name) for name in ("stepbus", "eclipse-zenoh")}
    parts = [heading(sys.argv[1:], time.monotonic() - began, versions)]
    parts += ["\n".join(table.lines()) for table in tables if table.lines()]
    text = "\n\n".join(parts) + "\n"
    _say(text)
    if options.table:
        options.table.write_text(text)
    return int(not is_whole or any(table.broken.total() for table in tables))


if __name__ == "__main__":
    sys.exit(main())
