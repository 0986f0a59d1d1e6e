"""`stepbus help`."""

from stepbus_orchestrator.cli.overview import command_names, load_command, overview
from stepbus_orchestrator.cli.terminal.output import say
from stepbus_orchestrator.cli.words import help_page
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


def help_command(topic: str) -> int:
    """Print the help of a command or topic, or that of all commands."""
    if not topic:
        say(overview().rstrip())
    elif topic == "which":
        say(_which())
    elif topic in command_names():
        say(help_page(load_command(topic)).rstrip())
    else:
        raise WiringError(f"no command {topic!r}{suggest(topic, (*command_names(), 'which'))}")
    return 0


def _which() -> str:
    lines = [f"{'':8}{'you have':16}it answers"]
    for name, given, question, example in _WHICH:
        lines += ["", f"{name:8}{given:16}{question}", f"{'':8}$ {example}"]
    return "\n".join(lines)
