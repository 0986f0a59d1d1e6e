"""`stepbus diff`: compare two recordings; and the options of every command that compares."""

import argparse
from pathlib import Path

from stepbus_orchestrator.analysis.diff import diff
from stepbus_orchestrator.analysis.tolerance import Tolerance, parse_tolerance, read_tolerance
from stepbus_orchestrator.cli.command import Command
from stepbus_orchestrator.cli.output import say, say_json
from stepbus_orchestrator.cli.parameters import add_parameters, parameters_of
from stepbus_orchestrator.errors import ExitCode


def add_tolerance_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of a comparison."""
    number, field = "[PORT[.FIELD]=]NUMBER", "PORT[.FIELD]"
    parser.add_argument(
        "--abs", action="append", default=[], metavar=number, help="absolute tolerance, e.g. 1e-9"
    )
    parser.add_argument(
        "--rel", action="append", default=[], metavar=number, help="relative tolerance"
    )
    parser.add_argument(
        "--ignore", action="append", default=[], metavar=field, help="leave out a port or field"
    )
    parser.add_argument(
        "--tolerance",
        type=Path,
        metavar="FILE",
        help="YAML file of tolerances (docs/guide/testing/replay.md)",
    )


def tolerance_of(args: argparse.Namespace, participant: str = "") -> Tolerance:
    """Return the tolerance of the options; the command line takes precedence over the file."""
    from_file = Tolerance() if args.tolerance is None else read_tolerance(args.tolerance)
    return from_file | parse_tolerance(args.abs, args.rel, args.ignore, participant)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_parameters(parser, diff, tolerance=add_tolerance_arguments, is_part=None)
    parser.add_argument("--json", action="store_true", help="print JSON for programs")


def _execute(args: argparse.Namespace) -> int:
    difference = diff(**parameters_of(args, diff) | {"tolerance": tolerance_of(args)})
    if args.json:
        say_json(difference)
    else:
        say(difference.text())
    return ExitCode.FINISHED if difference.equal else ExitCode.DIFFERENT


COMMAND = Command(
    name="diff",
    summary="compare two recordings, port by port",
    description="Compares the messages of two recordings byte for byte, or within a tolerance. The "
    "recordings may differ in length or be cut off. Shows the first difference first. PORT is a "
    "topic such as controller/command. Exit code 0: equal, 10: different.",
    examples=(
        "stepbus diff runs/a/run.mcap runs/b/run.mcap",
        "stepbus diff a.mcap b.mcap --abs controller/command.values=1e-9",
        "stepbus diff a.mcap b.mcap --tolerance tolerance.yaml --json",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
)
