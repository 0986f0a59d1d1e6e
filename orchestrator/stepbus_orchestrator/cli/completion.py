"""`stepbus completion`: what a shell needs to complete commands, options, scenarios and files."""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal

from cyclopts import App

from stepbus_orchestrator.scenario.locate import builtin_names

from .overview import COMPLETE, command_names, load_command, load_commands
from .parameters import Command
from .words import app_of


def completion_command(shell: Literal["bash", "zsh", "fish"]) -> int:
    """Print the completion script of a shell."""
    sys.stdout.write(_app(load_commands()).generate_completion(shell=shell) + "\n")
    return 0


def complete(words: Sequence[str]) -> None:
    """Print what the last of some words may become, as the script of a shell asks."""
    typed = words[:1] if words and words[0] in command_names() else ()
    _app(map(load_command, typed))([COMPLETE, *words], result_action="return_value")


def _app(commands: Iterable[Command]) -> App:
    app = App(name="stepbus", help_flags=(), version_flags=())
    for command in commands:
        app.command(app_of(command))
    return app


def scenarios(context: object) -> list[str]:
    """Return the scenarios that the word of a completion may become."""
    word: str = getattr(context, "incomplete", "")
    folder = Path(word) if word.endswith("/") else Path(word).parent
    near = folder.iterdir() if folder.is_dir() else ()
    files = [f"{path}/" if path.is_dir() else str(path) for path in near]
    return [*builtin_names(), *(file for file in files if file.endswith(("/", ".yaml")))]


def topics(_context: object) -> list[str]:
    """Return what `stepbus help` explains."""
    return [*command_names(), "which"]
