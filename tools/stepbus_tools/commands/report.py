"""`stepbus report`: the page of a run, or of several beside each other."""

import argparse
from pathlib import Path

from stepbus_orchestrator.cli import Command, print_error, say
from stepbus_tools.viewing.page import report


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "recordings",
        type=Path,
        nargs="+",
        metavar="RECORDING",
        help="the run.mcap of a run, or its folder; several are compared",
    )
    parser.add_argument(
        "--out", type=Path, help="the page (default: report.html beside the first recording)"
    )


def _execute(args: argparse.Namespace) -> int:
    problems: list[str] = []
    path = report(args.recordings, args.out, problems)
    for line in problems:
        print_error(line)
    say(f"wrote {path}")
    return 0


COMMAND = Command(
    name="report",
    summary="write report.html of a run, or compare several",
    description="Writes one HTML file that opens without a network: outcome and reason, curves of "
    "joints and of every other port with numbers, events and faults, step times, camera stills. "
    "Several recordings share their charts. `stepbus run` writes that of each run by itself.",
    examples=(
        "stepbus report runs/arm",
        "stepbus report runs/pd runs/pid --out comparison.html",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
)
