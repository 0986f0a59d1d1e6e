"""From another terminal: `stepbus join` and `bridge` become a participant, `call` asks one."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import msgspec
from rich.markup import escape
from rich.table import Table

from stepbus_orchestrator.cli.terminal.output import Answer, print_error, table, visible
from stepbus_orchestrator.processes.external import await_ticket
from stepbus_orchestrator.processes.warm import participant_environment
from stepbus_orchestrator.run.live_file import call
from stepbus_orchestrator.scenario.model import BridgeSpec, ParticipantSpec
from stepbus_orchestrator.scenario.program import command as program_command
from stepbus_orchestrator.scenario.program import start_command
from stepbus_participant import suggest
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import BridgeFormat, WiringError

_RUN = "run"
"""Stands for the run itself, as if it were a participant."""


def join_command(ticket: Path, *program: str, wait: float) -> NoReturn:
    """Become the participant of a ticket."""
    awaited = await_ticket(ticket, wait, _notify)
    folder = Path.cwd() if program else Path(awaited.folder)
    bridge = (
        BridgeSpec(format=awaited.bridge, describe=awaited.describe) if awaited.bridge else None
    )
    spec = ParticipantSpec(name=awaited.name, exec=tuple(program or awaited.exec), bridge=bridge)
    argv = start_command(spec, folder)
    _notify(f"{awaited.name} of run {awaited.run}: {' '.join(argv)}")
    _become(argv, folder, participant_environment(str(ticket.absolute())))


def _notify(sentence: str) -> None:
    print_error(sentence, "stepbus join")


def _become(argv: tuple[str, ...], folder: Path, environment: Mapping[str, str]) -> NoReturn:
    """Replace this process by a program, which keeps its pid: no shell is between us and it."""
    sys.stdout.flush()
    try:
        os.chdir(folder)
        os.execve(argv[0], argv, environment)  # noqa: S606
    except OSError as exc:
        raise WiringError(f"{exc.filename or argv[0]}: {exc.strerror}") from exc


def bridge_command(*program: str, format: BridgeFormat, describe: str) -> NoReturn:
    """Become the bridge of a program."""
    if not program:
        raise WiringError("no program given; write its command line after --")
    options = ("--format", format, "--describe", describe or "{}")
    here = Path.cwd()
    _become(
        program_command(("stepbus", "bridge", *options, "--", *program), here), here, os.environ
    )


def call_command(run: Path, participant: str, method: str, *args: str, json: bool) -> int:
    """Call a method of a live run, or list the methods."""
    if not method:
        offered = call(run).value
        if participant and participant not in offered:
            hint = suggest(participant, offered) or "; no participant of this run accepts calls"
            raise WiringError(f"{participant!r} does not accept calls{hint}")
        offers = {name: row for name, row in offered.items() if participant in {"", name}}
        return Answer(value=offers, lines=[_table(offers)]).show(as_json=json)
    values = [parse_yaml(text, text) for text in args]
    reply = call(run, "" if participant == _RUN else participant, method, values)
    shown = msgspec.json.encode(reply.value).decode()
    answer = Answer(value={"step": reply.step, "value": reply.value}, lines=[shown])
    return answer.show(as_json=json)


def _table(offers: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return the methods that participants offer."""
    made = table("participant", "method", "arguments and answer", "changes the run")
    for name, methods in offers.items():
        for method, item in methods.items():
            text = escape(visible(item["help"]))
            made.add_row(name, visible(method), text, "yes" if item["changes"] else "")
    return made
