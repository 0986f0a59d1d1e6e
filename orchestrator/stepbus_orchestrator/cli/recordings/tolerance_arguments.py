"""Options that say how far two messages may differ."""

import argparse
from pathlib import Path

from stepbus_orchestrator.analysis.comparison import Tolerance, parse_tolerance, read_tolerance


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
