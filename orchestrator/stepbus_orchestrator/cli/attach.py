"""From another terminal: `stepbus join` and `bridge` become a participant, `call` asks one."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import msgspec
from rich.markup import escape
from rich.table import Table

from stepbus_orchestrator.cli.commands import Bridge, Call, Join
from stepbus_orchestrator.cli.terminal.output import Answer, print_error, table, visible
from stepbus_orchestrator.processes.attached import await_ticket, check_files
from stepbus_orchestrator.processes.ticket_line import MARK, check_reachable, content_of, path_of
from stepbus_orchestrator.processes.warm import participant_environment
from stepbus_orchestrator.run.live_file import call
from stepbus_orchestrator.scenario.model import BridgeSpec, ParticipantSpec
from stepbus_orchestrator.scenario.program import command
from stepbus_participant import parse_duration, suggest
from stepbus_participant.parameters import parse_yaml
from stepbus_schemas import WiringError

_RUN = "run"
"""Stands for the run itself, as if it were a participant."""


def join_command(given: Join) -> int:
    """Wait for the run of a ticket, and become the participant's program."""
    path = given.ticket
    if str(given.ticket).startswith(MARK):
        path = Path(path_of(content_of(str(given.ticket))))
    awaited = await_ticket(path, parse_duration(given.wait) * 1e-9, _notify)
    check_reachable(awaited)
    folder = Path.cwd() if given.program else Path(awaited.folder or Path.cwd())
    check_files(awaited.files, folder)
    bridge = (
        BridgeSpec(format=awaited.bridge, describe=awaited.describe) if awaited.bridge else None
    )
    words = given.program or awaited.exec
    argv = command(ParticipantSpec(name=awaited.name, exec=words, bridge=bridge).program, folder)
    _notify(f"{awaited.name} of run {awaited.run}: {' '.join(argv)}")
    _become(argv, folder, participant_environment(str(path.absolute())))


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


def bridge_command(given: Bridge) -> int:
    """Become the bridge, which starts the program."""
    options = ("--format", given.format, "--describe", given.describe)
    here = Path.cwd()
    argv = command(("stepbus", "bridge", *options, "--", *given.program), here)
    _become(argv, here, os.environ)


def call_command(given: Call) -> Answer:
    """Return what a method answers, or the methods of the participants."""
    if not given.method:
        offered = call(given.run).value
        if given.participant and given.participant not in offered:
            hint = suggest(given.participant, offered)
            hint = hint or "; no participant of this run accepts calls"
            raise WiringError(f"{given.participant!r} does not accept calls{hint}")
        offers = {name: o for name, o in offered.items() if given.participant in {"", name}}
        return Answer(value=offers, lines=[_table(offers)])
    values = [parse_yaml(text, text) for text in given.args]
    participant = "" if given.participant == _RUN else given.participant
    reply = call(given.run, participant, given.method, values)
    shown = msgspec.json.encode(reply.value).decode()
    return Answer(value={"step": reply.step, "value": reply.value}, lines=[shown])


def _table(offers: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return the methods that participants offer."""
    made = table("participant", "method", "arguments and answer", "changes the run")
    for name, methods in offers.items():
        for method, item in methods.items():
            text = escape(visible(item["help"]))
            made.add_row(name, visible(method), text, "yes" if item["changes"] else "")
    return made
