"""`python -m stepbus_simulation`: runs tapes of faults, and says what does not hold."""

import argparse
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import Progress

import stepbus_orchestrator
import stepbus_participant

from .campaign import Count, Failure, campaign, execute, fingerprint, shortest
from .kinds import KINDS
from .programs import SCENARIOS
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
    parser.add_argument("--jobs", type=int, default=2, help="processes in parallel (default: 2)")
    parser.add_argument("--keep", type=Path, help="folder for the shortest failing tapes")
    parser.add_argument("--table", type=Path, help="write the table to this file, in Markdown")
    options = parser.parse_args()
    try:
        tapes = [load_tape(path) for path in options.tapes]
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as exc:
        parser.error(f"{exc}; a tape is a file that --keep has written")
    named = {fault.kind for tape in tapes for fault in tape.faults} - KINDS.keys()
    named |= {tape.scenario for tape in tapes} - SCENARIOS.keys()
    if named:
        parser.error(f"unknown kind of fault or scenario: {', '.join(sorted(named))}")
    if tapes:
        return max(map(_show, tapes))
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
    began, total = time.monotonic(), Count()
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("simulated runs", total=options.runs)
        for count in campaign(options.seed, options.runs, options.jobs):
            total.add(count)
            progress.update(task, completed=total.runs)
    lasted_s = time.monotonic() - began
    table = "\n".join(_markdown(total))
    print(table)
    if options.table is not None:
        options.table.write_text(table + "\n", encoding="utf-8")
    print(
        f"{total.runs} runs in {lasted_s:.0f} s: {total.runs / lasted_s * 3600:,.0f} an hour, "
        f"{total.simulated_s / lasted_s:.0f} simulated seconds a second"
    )
    return _print_failures(total, options.keep)


def _print_failures(total: Count, keep: Path | None) -> int:
    """Print what happened, and did not hold; return 1 where something did not."""
    codes = ", ".join(f"{code}: {count}" for code, count in sorted(total.codes.items()))
    print(f"exit codes: {codes}")
    missing = sorted(all_marks() - total.marks)
    print(f"marks reached: {len(total.marks)}; never: {'; '.join(missing) or 'none'}")
    if not total.failures:
        print("everything held")
        return 0
    by_kind: dict[str, list[Failure]] = {}
    for failure in total.failures:
        by_kind.setdefault(fingerprint(failure.problem), []).append(failure)
    print(f"{len(total.failures)} runs in which something did not hold:")
    for number, failures in enumerate(by_kind.values()):
        failure = shortest(min(failures, key=lambda one: len(one.tape.faults)))
        print(f"\n{len(failures)} × {failure.problem}\n    run {failure.number}: {failure.tape}")
        for text in execute(failure.tape)[0].as_options():
            print(f"    on real processes: --fault '{text}'")
        if keep is not None:
            keep.mkdir(parents=True, exist_ok=True)
            failure.tape.save(keep / f"{number}.json")
    return 1


def all_marks() -> set[str]:
    """Return every mark that stands in the source."""
    packages = (stepbus_orchestrator, stepbus_participant)
    files = (file for package in packages for file in Path(package.__path__[0]).rglob("*.py"))
    return {mark for file in files for mark in _MARK.findall(file.read_text(encoding="utf-8"))}


def _markdown(total: Count) -> Iterator[str]:
    """Yield the lines of the table for a page."""
    yield "| Kind | Fault | Runs it struck | Exit codes |"
    yield "|---|---|---|---|"
    for kind, row in KINDS.items():
        codes = total.codes_of.get(kind, set())
        numbers = sorted((code for code in codes if code.isdigit()), key=int)
        words = sorted(code for code in codes if not code.isdigit())
        struck = f"{total.effective[kind]:,}"
        yield f"| `{kind}` | {row.what} | {struck} | {', '.join([*numbers, *words])} |"
    yield ""
    yield "Runs by exit code: " + _listed(dict(sorted(total.codes.items())))
    yield "What was done with the recordings: " + _listed(dict(sorted(total.then.items())))
    yield "Marks that were reached: " + ", ".join(f"`{mark}`" for mark in sorted(total.marks)) + "."


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{name}: {count:,}" for name, count in counts.items()) + "."


if __name__ == "__main__":
    sys.exit(main())
