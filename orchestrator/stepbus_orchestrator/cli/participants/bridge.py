"""`stepbus bridge`: take part in a run on behalf of a program without Zenoh."""

import argparse
import os
import sys
from pathlib import Path

from stepbus_orchestrator.cli.command import Command
from stepbus_orchestrator.scenario.program import command
from stepbus_schemas import BRIDGE_FORMATS


def _add_arguments(parser: argparse.ArgumentParser) -> None:
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


def _execute(args: argparse.Namespace) -> int:
    """Become the bridge, a service of its own: this process is replaced."""
    options = ("--format", args.format, "--describe", args.describe)
    argv = command(("stepbus", "bridge", *options, "--", *args.program), Path.cwd())
    sys.stdout.flush()
    os.execv(argv[0], argv)  # noqa: S606  (no shell between us and the bridge, which keeps our pid)


COMMAND = Command(
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
    add_arguments=_add_arguments,
    execute=_execute,
)
