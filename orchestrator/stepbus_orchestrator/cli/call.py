"""`stepbus call`: ask a participant something while it runs, from a second terminal."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stepbus_orchestrator.cli.command import Command
from stepbus_orchestrator.cli.output import say, say_json, visible
from stepbus_orchestrator.run.live_file import call
from stepbus_participant import suggest
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

_RUN = "run"
"""Stands for the run itself, as if it were a participant."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, help="folder of a running run")
    parser.add_argument(
        "participant",
        nargs="?",
        default="",
        help="participant to ask, or `run`: the run itself; without it, lists all methods",
    )
    parser.add_argument("method", nargs="?", default="", help="method to call")
    parser.add_argument("args", nargs="*", metavar="ARG", help="arguments, as YAML values")
    parser.add_argument("--json", action="store_true", help="print the answer as JSON only")


def _execute(args: argparse.Namespace) -> int:
    if not args.method:
        _list(call(args.run).value, args.participant, as_json=args.json)
        return 0
    values = [parse_yaml(text, text) for text in args.args]
    name = "" if args.participant == _RUN else args.participant
    reply = call(args.run, name, args.method, values)
    if args.json:
        say_json({"step": reply.step, "value": reply.value})
    else:
        say(msgspec.json.encode(reply.value).decode())
    return 0


def _list(offered: Mapping[str, Mapping[str, Any]], participant: str, *, as_json: bool) -> None:
    if participant and participant not in offered:
        who = suggest(participant, offered) or "; no participant of this run does"
        raise WiringError(f"{participant!r} answers no calls{who}")
    rows = {name: methods for name, methods in offered.items() if participant in {"", name}}
    if as_json:
        say_json(rows)
        return
    table = Table(box=None, pad_edge=False)
    for column in ("participant", "method", "arguments and answer", "changes the run"):
        table.add_column(column, overflow="fold")
    for name, methods in rows.items():
        for method, item in methods.items():
            text = escape(visible(item["help"]))
            table.add_row(name, visible(method), text, "yes" if item["changes"] else "")
    Console().print(table)


COMMAND = Command(
    name="call",
    summary="ask a participant something while it runs",
    description="Asks a participant something while it runs, from a second terminal. It answers "
    "between two steps, and the question does not affect the result. A call that changes the run "
    "is recorded with its step; rerun, replay and branch repeat it there.",
    examples=(
        "stepbus call runs/two_link-20260101-120000",
        "stepbus call runs/two_link-20260101-120000 plant joint_position joint1",
        "stepbus call runs/two_link-20260101-120000 plant set_joint_position joint1 0.5",
        "stepbus call runs/two_link-20260101-120000 mission set_target joint1 30deg 0.5",
        "stepbus call runs/two_link-20260101-120000 controller set kp 90",
        "stepbus call runs/two_link-20260101-120000 run pause",
    ),
    add_arguments=_add_arguments,
    execute=_execute,
)
