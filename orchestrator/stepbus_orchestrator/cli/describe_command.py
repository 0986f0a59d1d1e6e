"""`stepbus describe`: who takes part, with which ports, joints and limits."""

from __future__ import annotations

import argparse
import math

from rich.console import Console
from rich.table import Table

from ..describe import PortDescription, describe
from ..scenario import load
from .command import Command, add_scenario_arguments
from .output import say, say_json

_LIMITS = ("lower", "upper", "velocity", "effort")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print JSON for programs")


def _execute(args: argparse.Namespace) -> int:
    ports = describe(load(args.scenario, args.set))
    if args.json:
        say_json(ports)
        return 0
    console = Console()
    for port in ports:
        taken = ", ".join(port.taken_by) or "nobody"
        say(f"{port.participant}.{port.port}: {port.type}, taken by {taken}")
        if port.description.names:
            console.print(_table(port))
        elif port.description.like:
            say(f"  in the order of its input {port.description.like}")
    return 0


def _table(port: PortDescription) -> Table:
    """Return one row per name: index, name, what else is told, limits."""
    said = port.description
    limits = [name for name in _LIMITS if name in said.limits]
    table = Table()
    for column in ("#", "name", *said.details, *limits):
        table.add_column(column, justify="right" if column in {"#", *_LIMITS} else "left")
    for index, name in enumerate(said.names):
        details = [said.details[key][index] for key in said.details]
        numbers = [_number(said.limits[key][index]) for key in limits]
        table.add_row(str(index), name, *details, *numbers)
    return table


def _number(value: float) -> str:
    return f"{value:g}" if math.isfinite(value) else "-"


COMMAND = Command(
    name="describe",
    summary="list ports, joints and limits without a step",
    description="Starts every participant, lets it load its model, and prints what it says of "
    "its outputs: names, types, modes, limits (rad, rad/s, N·m). No step is made.",
    examples=("stepbus describe two_link", "stepbus describe two_link --json"),
    add_arguments=_add_arguments,
    execute=_execute,
)
