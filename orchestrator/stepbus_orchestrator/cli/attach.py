"""From another terminal: `stepbus join` and `bridge` become a participant, `call` asks one."""

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NoReturn

import msgspec
from rich.markup import escape
from rich.table import Table

from stepbus_orchestrator.cli.parameters import DURATION, command
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


@command(group="attach")
def join_command(
    ticket: Path,
    program: Sequence[str] = (),
    *,
    wait: Annotated[
        float, {**DURATION, "help": "how long to wait for the run (default: 60s)"}
    ] = 60.0,
) -> int:
    """Start a participant of a run from another terminal, container or debugger.

    Waits for the run of a ticket, then runs the program in this terminal, with the arguments and
    environment that the run would have used (including the bridge). The run must expect it:
    `stepbus run --external NAME`, or `start: external` in the scenario. You can start either one
    first (docs/guide/running/attach.md). Exits with the program's exit code.

    ticket: the ticket, whose path the run prints. program: command line of the program, after `--`;
    default: the one in the scenario.

    $ stepbus join runs/two_link-20260101-120000/controller.ticket
    $ stepbus join /tmp/c.ticket -- python my_controller.py
    $ stepbus join --wait 10min /tmp/c.ticket -- python -m pdb my_controller.py
    """
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


@command(group="attach")
def bridge_command(
    program: Sequence[str],
    *,
    format: BridgeFormat = "json",
    describe: Annotated[str, {"metavar": "JSON"}] = "",
) -> int:
    """Connect a program to a run through the bridge.

    Joins a run with the ticket in STEPBUS_TICKET, starts a program, and exchanges every step with
    it over file descriptors 3 and 4 (docs/guide/writing/bridge.md). A scenario starts it with the
    key `bridge`, or explicitly: `exec: [stepbus, bridge, --format, json, --, node,
    controller.mjs]`.

    program: command line of the program, after `--`. format: format of the messages. describe:
    descriptions of the outputs, e.g. {"command": {"like": "joint_state"}}.

    $ stepbus bridge --format json -- node controller.mjs
    $ stepbus bridge --format raw -- octave-cli --quiet controller.m
    """
    if not program:
        raise WiringError("no program given; write its command line after --")
    options = ("--format", format, "--describe", describe or "{}")
    here = Path.cwd()
    _become(
        program_command(("stepbus", "bridge", *options, "--", *program), here), here, os.environ
    )


@command(group="attach")
def call_command(
    run: Path,
    participant: str = "",
    method: str = "",
    args: Annotated[Sequence[str], {"metavar": "ARG"}] = (),
) -> Answer:
    """Call a method of a participant in a live run.

    Calls a method of a participant in a live run, from a second terminal. The participant answers
    between two steps. A call that only reads does not affect the result. A call that changes the
    run is recorded with its step; rerun, replay and branch repeat it at that step.

    run: folder of a live run. participant: participant to call, or `run` for the run itself;
    without it, lists all methods. method: method to call. args: arguments, as YAML values.

    $ stepbus call runs/arm
    $ stepbus call runs/arm plant joint_position joint1
    $ stepbus call runs/arm plant set_joint_position joint1 0.5
    $ stepbus call runs/arm mission set_target joint1 30deg 0.5
    $ stepbus call runs/arm controller set kp 90
    $ stepbus call runs/arm run pause
    """
    if not method:
        offered = call(run).value
        if participant and participant not in offered:
            hint = suggest(participant, offered) or "; no participant of this run accepts calls"
            raise WiringError(f"{participant!r} does not accept calls{hint}")
        offers = {name: row for name, row in offered.items() if participant in {"", name}}
        return Answer(value=offers, lines=[_table(offers)])
    values = [parse_yaml(text, text) for text in args]
    reply = call(run, "" if participant == _RUN else participant, method, values)
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
