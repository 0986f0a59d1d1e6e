"""What `stepbus` answers without loading a command: its version, and all commands in their groups.

It imports little but the standard library: all else takes longer than the answer.
"""

import contextlib
import os
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple

from stepbus_orchestrator.cli.terminal.output import columns, fold, print_error
from stepbus_orchestrator.plugins import COMMANDS, metadata_folders, named_points

MODULES = {
    "run": "run",
    "validate": "scenarios",
    "describe": "scenarios",
    "new": "new",
    "info": "info",
    "types": "scenarios",
    "recover": "recover",
    "replay": "compare",
    "rerun": "rerun",
    "verify": "verify",
    "diff": "compare",
    "branch": "branch",
    "join": "attach",
    "bridge": "attach",
    "call": "attach",
    "help": "help",
    "completion": "completion",
}
"""Command of the core → its module here, where it is called `<name>_command`.

Only the one that is typed is loaded: all take half a second. The others are entry points."""

MORE = "more"
GROUPS = ("run", "look", "test", "attach", "many", MORE)
"""Groups of commands in the overview; a command of another package may name one too."""

_ABOUT = (
    "Co-simulation for robotics: plant, controller and mission as separate processes in lockstep "
    "over Zenoh, recorded to MCAP."
)
_ENDING = """stepbus help COMMAND     options and examples of a command
stepbus help which       replay, rerun, verify, diff, branch: which one?
stepbus --version        the version

example: stepbus run two_link"""


_OPTIONS = r"^@command\(([^\n]*\n(?:    [^\n]*\n)*\)?)\n?"
_DOCSTRING = r'def {}\([^\n]*\n(?:(?:    |\))[^\n]*\n)*?    """([^"\\]+)'
"""How a command of ours begins: to parse all that has one would take most of the answer's time."""


class CommandBroken(Exception):
    """A command of another package cannot be loaded."""


class Outline(NamedTuple):
    """What the overview says of a command: its summary, and the group that it stands in."""

    summary: str
    group: str


def answer(arguments: Sequence[str]) -> None:
    """Write what is asked for and exit, where that takes no command; else do nothing."""
    first = arguments[0] if arguments else ""
    if first not in {"", "-h", "--help", "--version"} or not_utf8(arguments):
        return
    if first == "--version":
        sys.stdout.write(f"stepbus {_version()}\n")
    else:
        (sys.stdout if first else sys.stderr).write(overview())
    raise SystemExit(0 if first else 2)


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


def command_names() -> tuple[str, ...]:
    """Return the names of all commands, in the order of the overview."""
    return tuple(dict.fromkeys((*MODULES, *named_points(COMMANDS))))


def outlines() -> dict[str, Outline]:
    """Return what the overview says of each command, by name; only what has to be is loaded.

    To load them all takes more than a second. One that cannot be loaded is left out, with an error.
    """
    rows = ((name, _outline(name)) for name in command_names())
    return {name: row for name, row in rows if row is not None}


def _outline(name: str) -> Outline | None:
    value = f"{__package__}.{MODULES.get(name)}:{name}_command"
    if name not in MODULES:
        value = named_points(COMMANDS)[name].value
    module, _, attribute = value.partition(":")
    if read := _read(_source(module), attribute):
        return read
    loaded = _load_or_report(name)
    return None if loaded is None else Outline(loaded.summary, loaded.group)


def load_commands() -> list[Any]:
    """Load all commands that can be loaded, in the order of the overview; name the others."""
    loaded = map(_load_or_report, command_names())
    return [command for command in loaded if command is not None]


def _load_or_report(name: str) -> Any:
    try:
        return load_command(name)
    except CommandBroken as exc:
        print_error(str(exc))
    return None


def load_command(name: str) -> Any:
    """Load a command by name; raises CommandBroken for one of another package that cannot be."""
    if name in MODULES:
        return getattr(import_module(f"{__package__}.{MODULES[name]}"), f"{name}_command")
    point = named_points(COMMANDS)[name]
    try:
        return point.load()
    except (ImportError, AttributeError) as exc:
        raise CommandBroken(
            f"the command {name!r} cannot be loaded from {point.value}: {exc}"
        ) from exc


def _read(source: str, function: str) -> Outline | None:
    """Return the outline of a command that is written as ours are; None of any other."""
    found = re.search(_OPTIONS + _DOCSTRING.format(re.escape(function)), source, re.MULTILINE)
    if found is None:
        return None
    options, text = found.groups()
    group = re.search(r'\bgroup="(\w+)"', options)
    if group is None and "group" in options:
        return None
    return Outline(summary_in(text), group[1] if group else MORE)


def summary_in(docstring: str) -> str:
    """Return the line of the overview, which a docstring begins with."""
    first = " ".join(docstring.split("\n\n", maxsplit=1)[0].split())
    return first[:1].lower() + first[1:].removesuffix(".")


def _source(module: str) -> str:
    """Return the source of a module; empty where it is no file. Imports nothing."""
    top, *below = module.split(".")
    try:
        spec = find_spec(top)
        folder = next(iter((spec and spec.submodule_search_locations) or ()))
        with open("/".join((folder, *below)) + ".py", encoding="utf-8") as file:  # noqa: PTH123
            return file.read()
    except (ImportError, OSError, ValueError, StopIteration):
        return ""
