"""`stepbus help`, and the overview of all commands."""

from typing import Annotated

from stepbus_orchestrator.cli.commands import command_names, make_parser, outlines
from stepbus_orchestrator.cli.parameters import GROUPS, MORE, command
from stepbus_orchestrator.cli.terminal.output import columns, fold, say
from stepbus_participant import suggest
from stepbus_schemas import WiringError

_ABOUT = (
    "Co-simulation for robotics: plant, controller and mission as separate processes in lockstep "
    "over Zenoh, recorded to MCAP."
)
_ENDING = """stepbus help COMMAND     options and examples of a command
stepbus help which       replay, rerun, verify, diff, branch: which one?
stepbus --version        the version

example: stepbus run two_link"""
_WHICH = (
    (
        "replay",
        "one recording",
        "Does this participant still publish what it did?",
        "stepbus replay runs/arm --participant controller",
    ),
    (
        "rerun",
        "one recording",
        "Does the whole run come out the same, here and now?",
        "stepbus rerun runs/arm",
    ),
    (
        "verify",
        "a scenario",
        "Is it the same under any load and in any order?",
        "stepbus verify two_link",
    ),
    (
        "diff",
        "two recordings",
        "Where do they differ first, and by how much?",
        "stepbus diff runs/arm runs/other",
    ),
    (
        "branch",
        "one recording",
        "What if something had been different from a step on?",
        "stepbus branch runs/arm --at 6s --set controller.params.kp=90",
    ),
)
"""Command, what you have, what it answers, an example."""


def overview() -> str:
    """Return all commands in their groups, a line each."""
    rows = outlines()
    names = max(map(len, rows), default=0)
    lines: list[str] = []
    for group in GROUPS:
        members = {
            name: row.summary
            for name, row in rows.items()
            if (row.group if row.group in GROUPS else MORE) == group
        }
        if members:
            lines += ["", group]
            lines += [f"  {name:{names}}  {text}" for name, text in members.items()]
    lines += ["", *_ENDING.splitlines()]
    folded = [fold(line, columns(), " " * (names + 2)) for line in lines]
    return "\n".join(["usage: stepbus COMMAND ...", "", fold(_ABOUT, columns()), *folded]) + "\n"


@command()
def help_command(topic: Annotated[str, {"complete": "command"}] = "") -> int:
    """Show the help of a command, or which command is the right one.

    Shows what a command does, its options and examples. `which` is a table of the five commands
    that compare runs. Without a topic, it lists all commands.

    topic: a command, or `which`.

    $ stepbus help run
    $ stepbus help which
    """
    if not topic:
        say(overview().rstrip())
    elif topic == "which":
        say(_which())
    elif topic in command_names():
        make_parser([topic]).parse_args([topic, "--help"])
    else:
        raise WiringError(f"no command {topic!r}{suggest(topic, (*command_names(), 'which'))}")
    return 0


def _which() -> str:
    lines = [f"{'':8}{'you have':16}it answers"]
    for name, given, question, example in _WHICH:
        lines += ["", f"{name:8}{given:16}{question}", f"{'':8}$ {example}"]
    return "\n".join(lines)
