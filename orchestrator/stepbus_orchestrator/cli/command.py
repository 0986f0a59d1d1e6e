"""What a command of the command line is: a row of data and two functions."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

_LAST_PORT = 65535


@dataclass(frozen=True, kw_only=True)
class Command:
    """One subcommand.

    name: as typed. summary: one line in the overview. description: above its own help. examples:
    command lines that work. add_arguments: declares its arguments. execute: does it and returns
    the exit code; errors are raised. is_run: runs a scenario, and ends in time
    though nobody reads what it prints.
    """

    name: str
    summary: str
    description: str
    examples: tuple[str, ...]
    add_arguments: Callable[[argparse.ArgumentParser], None]
    execute: Callable[[argparse.Namespace], int]
    is_run: bool = False


def add_overrides(
    parser: argparse.ArgumentParser, text: str = "override one value, e.g. window=1"
) -> None:
    """Declare `--set`; text: for the help."""
    parser.add_argument("--set", action="append", default=[], metavar="PATH=VALUE", help=text)


def number(what: str, least: int) -> Callable[[str], int]:
    """Return the type of an argument that is an integer; what: it, and its limit, in words."""

    def parse(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!r} is not {what}")
        return int(text)

    return parse


def seconds(text: str) -> float:
    """Return a time on the command line [s]."""
    try:
        duration_s = float(text)
    except ValueError:
        duration_s = 0.0
    if not 0 < duration_s < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds above 0, e.g. 60")
    return duration_s


def add_recording(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Declare the recording that a command reads; more: in its help, behind what it is."""
    text = f"the run.mcap of a run, or its folder{more}"
    parser.add_argument("recording", type=Path, help=text)


def port(text: str) -> int:
    """Return the number of a port; 0: any that is free."""
    if not text.isdecimal() or int(text) > _LAST_PORT:
        raise argparse.ArgumentTypeError(f"{text!r} is no port from 0 to {_LAST_PORT}")
    return int(text)


def add_foxglove(parser: argparse.ArgumentParser, how: str = "") -> None:
    """Declare `--foxglove`; how: in its help, before what it does."""
    parser.add_argument(
        "--foxglove",
        type=port,
        nargs="?",
        const=0,
        metavar="PORT",
        help=f"{how}send it to Foxglove and Lichtblick, over a WebSocket (default: any free port)",
    )


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what every command that takes a scenario understands."""
    parser.add_argument(
        "scenario",
        help="a scenario file, a folder with a scenario.yaml, or the name of a built-in one "
        "such as two_link or two_link/pd",
    )
    add_overrides(
        parser, "override one value, e.g. controller.params.kp=80 or duration=2s; may be repeated"
    )
