"""`stepbus bridge`: take part in a run on behalf of a program without Zenoh."""

from __future__ import annotations

from stepbus_orchestrator.bridge.arguments import add_arguments, execute
from stepbus_orchestrator.cli.command import Command

COMMAND = Command(
    name="bridge",
    summary="take part in a run on behalf of a program",
    description="Joins a run with the ticket of STEPBUS_TICKET, starts a program, and passes it "
    "each step over descriptors 3 and 4 (docs/bridge.md). A scenario starts it with the key "
    "`bridge`; by hand it is `exec: [stepbus, bridge, --format, json, --, node, controller.mjs]`.",
    examples=(
        "stepbus bridge --format json -- node controller.mjs",
        "stepbus bridge --format raw -- octave-cli --quiet controller.m",
    ),
    add_arguments=add_arguments,
    execute=execute,
)
