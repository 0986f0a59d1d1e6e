"""`stepbus describe`: the participants with their ports, joints and limits."""

import argparse
import math
import sys

import msgspec
from rich.console import Console
from rich.table import Table

from stepbus_orchestrator.cli.command import Command, add_scenario_arguments
from stepbus_orchestrator.cli.output import say, say_json
from stepbus_orchestrator.cli.signals import interruptible
from stepbus_orchestrator.run.describe import (
    JointRow,
    OutputPort,
    ParticipantDescription,
    describe,
)
from stepbus_orchestrator.scenario import load
from stepbus_schemas import Description

_NUMERIC = ("index", "lower", "upper", "velocity", "effort")
_UNLIMITED = "-"
_PLAIN_COLUMNS = 200


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print JSON for programs")


def _execute(args: argparse.Namespace) -> int:
    scenario = load(args.scenario, args.set)
    with interruptible() as interrupt:
        described = describe(scenario, interrupt)
    if args.json:
        say_json(described)
    else:
        _show(described)
    return 0


def _show(described: list[ParticipantDescription]) -> None:
    # A table that goes to a file or a pipe is not folded to the width of a terminal.
    console = Console(width=None if sys.stdout.isatty() else _PLAIN_COLUMNS)
    for participant in described:
        say(participant.participant)
        for item in participant.inputs:
            delay = f", {item.delay} steps old" if item.delay else ""
            say(f"  input   {item.port}: {item.type} from {item.source}{delay}")
        for output in participant.outputs:
            say(_headline(output))
            if output.joints:
                console.print(_joint_table(output.joints))
            elif output.description.names:
                console.print(_table(output.description))


def _headline(output: OutputPort) -> str:
    description = output.description
    facts = [f"taken by {', '.join(output.taken_by) or 'nobody'}"]
    if description.shape:
        facts.append(f"shape {' × '.join(map(str, description.shape))}")
    facts += [f"{field} in {unit}" for field, unit in description.units.items()]
    return f"  output  {output.port}: {output.type}, {'; '.join(facts)}"


def _joint_table(joints: list[JointRow]) -> Table:
    """Return one row per joint, without empty columns."""
    rows = [msgspec.structs.asdict(joint) for joint in joints]
    columns = [
        c for c in JointRow.__struct_fields__ if any(row[c] not in ("", None) for row in rows)
    ]
    table = _empty_table(columns)
    for row in rows:
        table.add_row(*(_cell(row[column]) for column in columns))
    return table


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if value is None:
        return ""
    return _number(value) if isinstance(value, float) else str(value)


def _empty_table(columns: list[str]) -> Table:
    table = Table(*columns)
    for column in table.columns:
        column.justify = "right" if column.header in _NUMERIC else "left"
    return table


def _table(description: Description) -> Table:
    """Return one row per name: index, name, details, limits."""
    table = _empty_table(["index", "name", *description.details, *description.limits])
    for index, name in enumerate(description.names):
        details = [values[index] for values in description.details.values()]
        numbers = [_number(values[index]) for values in description.limits.values()]
        table.add_row(str(index), name, *details, *numbers)
    return table


def _number(value: float) -> str:
    return f"{value:g}" if math.isfinite(value) else _UNLIMITED


COMMAND = Command(
    name="describe",
    summary="list ports, joints and limits; make no step",
    description="Starts every participant, lets it load its model, and prints its inputs and the "
    "descriptions of its outputs: names, types, modes, limits (rad, rad/s, N·m; - for none), and "
    "whether the motor of a joint is on. It is off in the modes passive and teleport, and when its "
    "effort limit is 0. Makes no step and records nothing. Exit codes are those of run.",
    examples=(
        "stepbus describe two_link",
        "stepbus describe two_link/pd --set plant.params.world=world.yaml",
        "stepbus describe two_link --json",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
)
