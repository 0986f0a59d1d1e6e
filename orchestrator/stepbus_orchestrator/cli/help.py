"""`stepbus help`."""

from typing import Annotated

from stepbus_orchestrator.cli.commands import make_parser
from stepbus_orchestrator.cli.overview import command_names, overview
from stepbus_orchestrator.cli.parameters import command
from stepbus_orchestrator.cli.terminal.output import say
from stepbus_participant import suggest
from stepbus_schemas import WiringError

_WHICH = (
    (
        "replay",
        "one recording",
        "Does this participant still produce the recorded outputs?",
        "stepbus replay runs/arm --participant controller",
    ),
    (
        "rerun",
        "one recording",
        "Does the whole run reproduce on this machine?",
        "stepbus rerun runs/arm",
    ),
    (
        "verify",
        "a scenario",
        "Is the result independent of timing and start order?",
        "stepbus verify two_link",
    ),
    (
        "diff",
        "two recordings",
        "Where do they first differ, and by how much?",
        "stepbus diff runs/arm runs/other",
    ),
    (
        "branch",
        "one recording",
        "What changes if I modify something from a step on?",
        "stepbus branch runs/arm --at 6s --set controller.params.kp=90",
    ),
)
"""Command, what you have, what it answers, an example."""


@command()
def help_command(topic: Annotated[str, {"complete": "command"}] = "") -> int:
    """Show the help of a command, or help to choose a command.

    Shows what a command does, its options and examples. `which` compares the five commands that
    compare runs. Without a topic, it lists all commands.

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
