"""The parser of the command line: finds the command that is typed, and executes it."""

import argparse
import contextlib
import re
import sys
import textwrap
from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from stepbus_orchestrator.cli.output import print_error
from stepbus_orchestrator.cli.stdout_buffer import hurry
from stepbus_orchestrator.errors import ExitCode, RunFailure, command_line
from stepbus_orchestrator.plugins import COMMANDS, named_points
from stepbus_participant import suggest
from stepbus_schemas import StepbusError, WiringError

from .parameters import Command

_COLUMNS = 79

_MODULES = {
    "run": "run",
    "validate": "scenarios",
    "describe": "scenarios",
    "types": "scenarios",
    "call": "attach",
    "new": "new",
    "replay": "compare",
    "diff": "compare",
    "verify": "verify",
    "rerun": "rerun",
    "branch": "branch",
    "recover": "recover",
    "bridge": "attach",
    "join": "attach",
}
"""Command of the core → its module here, where it is called `<name>_command`.

Only the one that is typed is loaded: all take half a second. The others are entry points, which
take a while to find."""

_CHOICE = re.compile(r"invalid choice: '([^']*)' \(choose from (.*)\)")
_UNKNOWN = re.compile(r"unrecognized arguments: (--[\w-]+)")
_OPTION = re.compile(r"(?<!\w)--[a-z][\w-]*")


def load_commands(names: Iterable[str] | None = None) -> tuple[Command, ...]:
    """Load commands by name; default: all that can be loaded, in the order of the overview.

    Raises WiringError for one by name of another package that cannot be loaded.
    """
    if names is not None:
        return tuple(map(_load, names))
    commands = []
    for name in dict.fromkeys((*_MODULES, *named_points(COMMANDS))):
        try:
            commands.append(_load(name))
        except WiringError as exc:
            # The others are listed all the same.
            print_error(str(exc))
    return tuple(commands)


def _load(name: str) -> Command:
    if name in _MODULES:
        module = import_module(f"{__package__}.{_MODULES[name]}")
        command: Command = getattr(module, f"{name}_command")
        return command
    point = named_points(COMMANDS)[name]
    try:
        loaded = point.load()
    except (ImportError, AttributeError) as exc:
        raise WiringError(
            f"the command {name!r} cannot be loaded from {point.value}: {exc}"
        ) from exc
    if not isinstance(loaded, Command):
        raise WiringError(f"the command {name!r} is no Command: {point.value}")
    return loaded


def make_parser(names: Iterable[str] | None = None) -> argparse.ArgumentParser:
    """Return the parser of commands by name; default: all."""
    parser = _Parser(
        prog="stepbus",
        description="Co-simulation for robotics: plant, controller and mission as separate "
        "processes in lockstep over Zenoh, recorded to MCAP.",
        epilog="example: stepbus run two_link",
    )
    parser.add_argument(
        "--version", action=_ShowVersion, nargs=0, help="show program's version number and exit"
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for command in load_commands(names):
        sub = commands.add_parser(
            command.name,
            help=command.summary,
            description=textwrap.fill(command.description, _COLUMNS),
            epilog="examples:\n" + "\n".join(f"  {line}" for line in command.examples),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add_arguments(sub)
        sub.set_defaults(command=command)
        parser.commands = (*parser.commands, sub)
    return parser


class _Parser(argparse.ArgumentParser):
    """Tells of a wrong word which one is meant. commands: the parsers of the commands."""

    commands: Sequence[argparse.ArgumentParser] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Take all words behind `--` as those of a program: argparse would take some as options."""
        words = list(args or ())
        takes_program = self.get_default("program") is not None
        end = words.index("--") if takes_program and "--" in words else len(words)
        known, others = super().parse_known_args(words[:end], namespace)
        if takes_program:
            known.program = [*known.program, *words[end + 1 :]]
        return known, others

    def error(self, message: str) -> NoReturn:
        """End with the sentence."""
        choice = _CHOICE.search(message)
        unknown = _UNKNOWN.search(message)
        if choice is not None:
            message += _meant(choice[1], re.findall(r"'([^']+)'", choice[2]))
        elif unknown is not None:
            helps = "".join(parser.format_help() for parser in self.commands)
            message += _meant(unknown[1], _OPTION.findall(helps))
        super().error(message)


def _meant(word: str, known: Sequence[str]) -> str:
    near = suggest(word, known)
    return near if "did you mean" in near else ""


class _ShowVersion(argparse.Action):
    """Shows the version, which takes a search of what is installed."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

        try:
            installed = version("stepbus")
        except PackageNotFoundError:
            installed = "(not installed, only found)"
        sys.stdout.write(f"stepbus {installed}\n")
        parser.exit()


def _no_text(arguments: Sequence[str]) -> str:
    """Return an argument, or the current folder, that cannot be written as UTF-8."""
    words = list(arguments)
    with contextlib.suppress(OSError):
        words.append(str(Path.cwd()))
    # Python reads bytes that are no text as surrogates.
    return next((word for word in words if any("\ud800" <= c <= "\udfff" for c in word)), "")


def _typed(arguments: Sequence[str]) -> Sequence[str] | None:
    """Return the command that is typed, none for `--version`; None: show all."""
    first = arguments[0] if arguments else ""
    if first == "--version":
        return ()
    # The core's own first: to find the others takes a while.
    is_command = first in _MODULES or (
        not first.startswith("-") and first in named_points(COMMANDS)
    )
    return (first,) if is_command else None


def execute(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    if odd := _no_text(arguments):
        print_error(f"{odd!a} is no UTF-8, in which all is recorded; is LC_ALL=C.UTF-8 missing?")
        return ExitCode.SCENARIO
    try:
        # Without a command that exists, the overview or the error shows all of them.
        args = make_parser(_typed(arguments)).parse_args(arguments)
        if args.command.is_run:
            hurry()
        with command_line():
            code: int = args.command.execute(args)
    except RunFailure as exc:
        print_error(str(exc))
        return exc.code
    except StepbusError as exc:
        print_error(str(exc))
        return ExitCode.SCENARIO
    except OSError as exc:
        # What no command expects of a file or folder, e.g. that the current one is gone.
        print_error(f"{exc.filename or 'the current folder'}: {exc.strerror or exc}")
        return ExitCode.INTERNAL
    return code
