"""`python -m stepbus_simulation`: runs tapes of faults, and says what does not hold."""

import argparse
import re
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

import stepbus_orchestrator
import stepbus_participant

from .campaign import Outcome, campaign, execute, fingerprint, shortest
from .kinds import KINDS
from .tape import Tape, load_tape

_MARK = re.compile(r'\breached\("([^"]+)"\)')
_EXAMPLES = """examples:
  python -m stepbus_simulation --runs 10000 --seed 1
  python -m stepbus_simulation tests/simulation/tapes/log_twice.json"""


def main() -> int:
    """Run what the arguments ask for; return 1 where something did not hold."""
    parser = argparse.ArgumentParser(
        prog="python -m stepbus_simulation",
        description=__doc__.partition(": ")[2] if __doc__ else "",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("tapes", nargs="*", type=Path, help="tapes to run and trace")
    parser.add_argument(
        "--runs", type=int, default=10_000, help="number of runs to draw (default: 10,000)"
    )
    parser.add_argument("--seed", type=int, default=1, help="seed of the runs (default: 1)")
    parser.add_argument("--keep", type=Path, help="folder for the shortest failing tapes")
    options = parser.parse_args()
    if options.tapes:
        return max(map(_show, map(load_tape, options.tapes)))
    return _campaign(options)


def _show(tape: Tape) -> int:
    execution, problems = execute(tape, keeps_trace=True)
    print(*execution.world.trace or (), sep="\n")
    print(execution.result or execution.refusal or "no result")
    for text in execution.as_options():
        print(f"on real processes: --fault '{text}'")
    for problem in problems:
        print(f"does not hold: {problem}")
    return 1 if problems else 0


def _campaign(options: argparse.Namespace) -> int:
    """Print what happened, and did not hold; return 1 where something did not."""
    began, outcomes = time.monotonic(), list[Outcome]()
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("simulated runs", total=options.runs)
        for outcome in campaign(options.seed, options.runs):
            outcomes.append(outcome)
            progress.update(task, advance=1)
    lasted_s = time.monotonic() - began
    print(*_table(outcomes), sep="\n")
    codes = Counter(outcome.code for outcome in outcomes)
    print("\nexit codes: " + ", ".join(f"{code}: {codes[code]}" for code in sorted(codes)))
    marks = set[str]().union(*(outcome.marks for outcome in outcomes))
    missing = sorted(all_marks() - marks)
    print(f"marks reached: {len(marks)}; never: {'; '.join(missing) or 'none'}")
    print(
        f"{len(outcomes)} runs in {lasted_s:.0f} s: {3600 * len(outcomes) / lasted_s:,.0f} an hour"
    )
    failures = [outcome for outcome in outcomes if outcome.problem]
    _print_failures(failures, options.keep)
    return 1 if failures else 0


def _print_failures(failures: list[Outcome], keep: Path | None) -> None:
    """Print, and keep, the shortest tape of each kind of failure."""
    print(
        f"{len(failures)} runs in which something did not hold" if failures else "everything held"
    )
    by_kind: dict[str, list[Outcome]] = {}
    for failure in failures:
        by_kind.setdefault(fingerprint(failure.problem), []).append(failure)
    for number, rows in enumerate(by_kind.values()):
        one = min(rows, key=lambda row: len(row.tape.faults))
        tape, problem = shortest(one.tape, one.problem)
        print(f"\n{len(rows)} × {problem}\n    {tape}")
        for text in execute(tape)[0].as_options():
            print(f"    on real processes: --fault '{text}'")
        if keep is not None:
            keep.mkdir(parents=True, exist_ok=True)
            tape.save(keep / f"{number}.json")


def all_marks() -> set[str]:
    """Return every mark that stands in the source."""
    packages = (stepbus_orchestrator, stepbus_participant)
    files = (file for package in packages for file in Path(package.__path__[0]).rglob("*.py"))
    return {mark for file in files for mark in _MARK.findall(file.read_text(encoding="utf-8"))}


def _table(outcomes: list[Outcome]) -> Iterator[str]:
    """Yield the lines of a table in Markdown: a row for each kind of fault."""
    yield "| Kind | Fault | Runs it struck | Exit codes |"
    yield "|---|---|---|---|"
    for kind, row in KINDS.items():
        codes = [outcome.code for outcome in outcomes if kind in outcome.kinds]
        distinct = sorted(set(codes), key=lambda code: (not code.isdigit(), code.zfill(3)))
        yield f"| `{kind}` | {row.what} | {len(codes):,} | {', '.join(distinct)} |"


if __name__ == "__main__":
    sys.exit(main())
