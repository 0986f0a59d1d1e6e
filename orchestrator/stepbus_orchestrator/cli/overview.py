"""Which commands there are, and what `stepbus` answers without running one: version and help.

It imports little but the standard library: all else takes longer than the answer.
"""

import contextlib
import os
import re
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import TYPE_CHECKING

from stepbus_orchestrator.cli.terminal.output import columns, fold, print_error
from stepbus_orchestrator.plugins import COMMANDS, metadata_folders, named_points

if TYPE_CHECKING:
    from .parameters import Command

MORE = "more"
GROUPS = {
    "run": ("run", "validate", "describe", "new"),
    "look": ("info", "types", "recover"),
    "test": ("replay", "rerun", "verify", "diff", "branch"),
    "attach": ("join", "bridge", "call"),
    "many": (),
    MORE: ("help", "completion"),
}
"""Group of the overview → commands of the core, which its module in `syntax` declares; a command of
another package may name a group too."""
MODULES = {name: f"{__package__}.syntax.{group}" for group, row in GROUPS.items() for name in row}

_ABOUT = (
    "Co-simulation for robotics: plant, controller and mission as separate processes in lockstep "
    "over Zenoh, recorded to MCAP."
)
_ENDING = """stepbus help COMMAND     options and examples of a command
stepbus help which       replay, rerun, verify, diff, branch: which one?
stepbus --version        the version

example: stepbus run two_link"""
HELP = ("-h", "--help")
COMPLETE = "__complete"
"""What the completion scripts of cyclopts call to complete a word."""


class CommandBroken(Exception):
    """A command of another package cannot be loaded."""


def answer(arguments: Sequence[str]) -> None:
    """Write what is asked for and exit, where that takes no command; else do nothing."""
    if not_utf8(arguments):
        return
    first = arguments[0] if arguments else ""
    if first == "--version":
        sys.stdout.write(f"stepbus {_version()}\n")
    elif first == COMPLETE:
        import_module(f"{__package__}.completion").complete(arguments[1:])
    elif first in {"", *HELP}:
        (sys.stdout if first else sys.stderr).write(overview())
    elif not (text := _help_asked(arguments)):
        return
    else:
        sys.stdout.write(text)
    raise SystemExit(0 if first else 2)


def _help_asked(arguments: Sequence[str]) -> str:
    """Return the help of a command where an option asks for it; else nothing."""
    name, *words = arguments
    if not set(HELP) & set(words) or name not in command_names():
        return ""
    try:
        command = load_command(name)
    except CommandBroken:
        return ""
    # What follows is of a program.
    own = words[: words.index(command.rest)] if command.rest in words else words
    return help_page(command) if set(HELP) & set(own) else ""


def help_page(command: "Command") -> str:
    """Return what a command does, its options and examples."""
    page: str = import_module(f"{__package__}.words").help_page(command)
    return page


def not_utf8(arguments: Sequence[str]) -> str:
    """Return an argument, or the current folder, that cannot be written as UTF-8."""
    words = list(arguments)
    # It may be gone.
    with contextlib.suppress(OSError):
        words.append(os.getcwd())  # noqa: PTH109  (see the top)
    # Python reads bytes that are no text as surrogates.
    return next((word for word in words if any("\ud800" <= c <= "\udfff" for c in word)), "")


def _version() -> str:
    """Return the version of stepbus, as `importlib.metadata` would."""
    names = (os.path.basename(folder) for folder in metadata_folders())  # noqa: PTH119
    found = (re.fullmatch(r"stepbus-(.+)\.(?:dist|egg)-info", name) for name in names)
    return next((match[1] for match in found if match), "(not installed)")


def overview() -> str:
    """Return all commands in their groups, a line each."""
    commands = list(load_commands())
    width = max(len(command.name) for command in commands)
    lines: list[str] = []
    for group in GROUPS:
        members = [c for c in commands if (c.group if c.group in GROUPS else MORE) == group]
        if members:
            lines += ["", group, *(f"  {c.name:{width}}  {c.summary}" for c in members)]
    lines += ["", *_ENDING.splitlines()]
    folded = [fold(line, columns(), " " * (width + 2)) for line in lines]
    return "\n".join(["usage: stepbus COMMAND ...", "", fold(_ABOUT, columns()), *folded]) + "\n"


def command_names() -> tuple[str, ...]:
    """Return the names of all commands, in the order of the overview."""
    return tuple(dict.fromkeys((*MODULES, *named_points(COMMANDS))))


def load_commands() -> Iterator["Command"]:
    """Load all commands that can be loaded, in the order of the overview; name the others."""
    for name in command_names():
        try:
            yield load_command(name)
        except CommandBroken as exc:
            print_error(str(exc))


def load_command(name: str) -> "Command":
    """Load a command by name; raises CommandBroken for one of another package that cannot be."""
    if name in MODULES:
        own: Command = getattr(import_module(MODULES[name]), f"{name}_command")
        return own
    point = named_points(COMMANDS)[name]
    try:
        loaded: Command = point.load()
        _ = loaded.summary
    except Exception as exc:
        why = " ".join(str(exc).split())
        raise CommandBroken(
            f"the command {name!r} cannot be loaded from {point.value}: {why}"
        ) from exc
    return loaded
