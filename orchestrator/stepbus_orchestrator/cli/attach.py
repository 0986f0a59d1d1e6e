"""`stepbus join` and `bridge`: this process becomes a participant, or the bridge to one."""

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

from stepbus_orchestrator.cli.command import Command
from stepbus_orchestrator.cli.output import visible
from stepbus_orchestrator.processes.launcher import participant_environment
from stepbus_orchestrator.processes.shared_ticket import JoinTicket, await_ticket
from stepbus_orchestrator.scenario.program import command
from stepbus_participant import parse_duration
from stepbus_schemas import BRIDGE_FORMATS, WiringError


def _add_join_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("ticket", type=Path, help="the ticket, as the run prints it")
    parser.add_argument(
        "--wait",
        default="60s",
        metavar="DURATION",
        help="how long to wait for the run, where it is not there yet (default: 60s)",
    )
    parser.add_argument(
        "program",
        nargs="*",
        help="command line of the program, after `--`; default: that of the scenario",
    )
    usual = parser.parse_known_args

    def parse(args: Any = None, namespace: Any = None) -> Any:
        """Take everything after `--` as the program, also where options stand before it."""
        words = list(args or [])
        end = words.index("--") if "--" in words else len(words)
        known, others = usual(words[:end], namespace)
        known.program += words[end + 1 :]
        return known, others

    # argparse itself takes no words behind an option that follows another word.
    parser.parse_known_args = parse  # type: ignore[method-assign]


def _execute_join(args: argparse.Namespace) -> int:
    """Become the participant: this process is replaced by its program, and keeps its pid."""
    ticket = await_ticket(args.ticket, parse_duration(args.wait) * 1e-9, _notify)
    folder = Path.cwd() if args.program else Path(ticket.folder)
    argv = _argv(ticket, args.program or ticket.exec, folder)
    _notify(f"{ticket.name} of run {ticket.run}: {' '.join(argv)}")
    sys.stdout.flush()
    try:
        os.chdir(folder)
        os.execve(argv[0], argv, participant_environment(args.ticket.absolute()))  # noqa: S606  (no shell between us and the program, which keeps our pid)
    except OSError as exc:
        raise WiringError(f"{exc.filename or argv[0]}: {exc.strerror}") from exc


def _argv(ticket: JoinTicket, words: list[str], folder: Path) -> tuple[str, ...]:
    """Return the command line of a program, or of the bridge to it where the scenario has one."""
    if not ticket.bridge:
        return command(words, folder)
    describe = ("--describe", json.dumps(ticket.describe)) if ticket.describe else ()
    options = ("--format", ticket.bridge, *describe)
    return command(("stepbus", "bridge", *options, "--", *words), folder)


def _notify(sentence: str) -> None:
    sys.stderr.write(f"stepbus join: {visible(sentence)}\n")
    sys.stderr.flush()


JOIN = Command(
    name="join",
    summary="start a participant of a run from another terminal, container or debugger",
    description="Waits for the run of a ticket, then becomes the program: in its own place, with "
    "this terminal, as the run would have started it (bridge included). The run waits for it: "
    "`stepbus run --external NAME`, or `start: external` in the scenario. Either may be first "
    "(docs/guide/running/attach.md). The exit code is that of the program.",
    examples=(
        "stepbus join runs/two_link-20260101-120000/controller.ticket",
        "stepbus join /tmp/c.ticket -- python my_controller.py",
        "stepbus join --wait 10min /tmp/c.ticket -- python -m pdb my_controller.py",
    ),
    add_arguments=_add_join_arguments,
    execute=_execute_join,
)


def _add_bridge_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--format", choices=BRIDGE_FORMATS, default="json", help="format of the messages"
    )
    parser.add_argument(
        "--describe",
        default="{}",
        metavar="JSON",
        help='descriptions of the outputs, e.g. {"command": {"like": "joint_state"}}',
    )
    parser.add_argument("program", nargs="+", help="command line of the program, after `--`")


def _execute_bridge(args: argparse.Namespace) -> int:
    """Become the bridge, a service of its own: this process is replaced."""
    options = ("--format", args.format, "--describe", args.describe)
    argv = command(("stepbus", "bridge", *options, "--", *args.program), Path.cwd())
    sys.stdout.flush()
    os.execv(argv[0], argv)  # noqa: S606  (no shell between us and the bridge, which keeps our pid)


BRIDGE = Command(
    name="bridge",
    summary="take part in a run on behalf of a program",
    description="Joins a run with the ticket of STEPBUS_TICKET, starts a program, and exchanges "
    "each step with it over descriptors 3 and 4 (docs/guide/writing/bridge.md). A scenario starts "
    "it with the key `bridge`; by hand: `exec: [stepbus, bridge, --format, json, --, node, "
    "controller.mjs]`.",
    examples=(
        "stepbus bridge --format json -- node controller.mjs",
        "stepbus bridge --format raw -- octave-cli --quiet controller.m",
    ),
    add_arguments=_add_bridge_arguments,
    execute=_execute_bridge,
)
