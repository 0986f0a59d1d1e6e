"""The parser of the command line: finds the command that is typed, and executes it."""

import argparse
import contextlib
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NoReturn

import msgspec

from stepbus_orchestrator.cli.terminal.output import fold, print_error
from stepbus_orchestrator.cli.terminal.stdout_buffer import hurry
from stepbus_orchestrator.errors import ExitCode, RunFailure, command_line
from stepbus_orchestrator.plugins import COMMANDS, named_points
from stepbus_orchestrator.processes.warm import warm_parent
from stepbus_orchestrator.scenario.model import ScenarioFile
from stepbus_participant import suggest
from stepbus_schemas import StepbusError

from .overview import MODULES, CommandBroken, command_names, load_command, load_commands, not_utf8

_CHOICE = re.compile(r"invalid choice: '([^']*)' \(choose from (.*)\)")
_NOT_TAKEN = ("unrecognized arguments: ", "the following arguments are required: ")
_OPTION = re.compile(r"(?<!\w)--[a-z][\w-]*")


def make_parser(names: Iterable[str] | None = None) -> "_Parser":
    """Return the parser of commands by name; default: all."""
    parser = _Parser(prog="stepbus")
    # The overview has answered it.
    parser.add_argument("--version", action="store_true", help="show the version and exit")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for command in load_commands() if names is None else map(load_command, names):
        sub = commands.add_parser(
            command.name,
            help=command.summary,
            description=command.description,
            epilog="examples:\n" + "\n".join(f"  {line}" for line in command.examples),
            formatter_class=_Formatter,
        )
        command.add_arguments(sub)
        sub.set_defaults(command=command)
        parser.commands = (*parser.commands, sub)
    return parser


class _Formatter(argparse.HelpFormatter):
    """Breaks lines between words only; examples stay as they are."""

    def _split_lines(self, text: str, width: int) -> list[str]:
        return fold(" ".join(text.split()), width).split("\n")

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        lines = text.split("\n")
        return "\n".join(row if row.startswith("  ") else fold(row, width, indent) for row in lines)


class _Parser(argparse.ArgumentParser):
    """Tells of a wrong word which one is meant. commands: the parsers of the commands."""

    commands: Sequence[argparse.ArgumentParser] = ()
    _words: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Take all words behind `--` as those of a program: argparse would take some as options."""
        words = list(args or ())
        takes_program = self.get_default("program") is not None
        end = words.index("--") if takes_program and "--" in words else len(words)
        self._words = words[:end]
        known, others = super().parse_known_args(words[:end], namespace)
        if takes_program:
            known.program = [*known.program, *words[end + 1 :]]
        return known, others

    def error(self, message: str) -> NoReturn:
        """End with the sentence."""
        choice = _CHOICE.search(message)
        unknown = self._unknown_option() if message.startswith(_NOT_TAKEN) else ""
        if choice is not None:
            message += _meant(choice[1], re.findall(r"'([^']+)'", choice[2]))
        elif unknown:
            message = f"unknown option {unknown}{self._meant_option(unknown)}"
        # What is wrong with an option, its own parser says; what is none, that of all commands.
        prog = self.commands[0].prog if len(self.commands) == 1 else self.prog
        _refuse(message, prog)

    def _unknown_option(self) -> str:
        """Return the first word that looks like an option, and is none of the command."""
        known = self._options()
        words = [word.partition("=")[0] for word in self._words if _OPTION.match(word)]
        return next((w for w in words if not any(one.startswith(w) for one in known)), "")

    def _options(self) -> list[str]:
        return _OPTION.findall("".join(p.format_help() for p in self.commands or (self,)))

    def _meant_option(self, word: str) -> str:
        """Return which option is meant, or which value of the scenario, where one is near."""
        known = self._options()
        if (near := _meant(word, known)) or "--set" not in known:
            return near
        fields = (field.encode_name for field in msgspec.structs.fields(ScenarioFile))
        values = {f"--{field}": f"--set {field}=VALUE" for field in fields}
        if word in values:
            return f"; did you mean '{values[word]}'?"
        near = _meant(word, list(values))
        return next((near.replace(one, values[one]) for one in values if f"'{one}'" in near), "")


def _refuse(message: str, prog: str = "stepbus") -> NoReturn:
    end = "" if message.endswith("?") else ";"
    print_error(f"{message}{end} see {prog} --help")
    raise SystemExit(int(ExitCode.SCENARIO))


def _meant(word: str, known: Sequence[str]) -> str:
    near = suggest(word, known)
    return near if "did you mean" in near else ""


def _parsed(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the command that is typed, with its arguments; or show its help, and exit."""
    first = arguments[0]
    if first.startswith("-"):
        _refuse(f"{first} is not an option of stepbus; write options after the command")
    # The core's own first: to find the others takes a while.
    if first not in MODULES and first not in named_points(COMMANDS):
        _refuse(f"no command {first!r}{_meant(first, command_names())}")
    return make_parser((first,)).parse_args(arguments)


def execute(arguments: Sequence[str], loaded: Callable[[], None] = lambda: None) -> int:
    """Run one command and return its exit code. loaded: is called when it is loaded."""
    if odd := not_utf8(arguments):
        print_error(
            f"{odd!a} is not valid UTF-8; if it is valid in your terminal, set LC_ALL=C.UTF-8"
        )
        return ExitCode.SCENARIO
    try:
        # From the start on: it loads on a core of its own what participants need.
        is_forking = arguments[0] == "run" and "--in-process" not in arguments
        with warm_parent() if is_forking else contextlib.nullcontext():
            args = _parsed(arguments)
            loaded()
            if args.command.is_run:
                hurry()
            with command_line():
                code: int = args.command.execute(args)
    except RunFailure as exc:
        print_error(str(exc))
        return exc.code
    except (StepbusError, CommandBroken) as exc:
        print_error(str(exc))
        return ExitCode.SCENARIO
    except OSError as exc:
        # What no command expects of a file or folder, e.g. that the current one is gone.
        print_error(f"{exc.filename or 'the current folder'}: {exc.strerror or exc}")
        return ExitCode.INTERNAL
    return code
