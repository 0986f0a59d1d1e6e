"""Which commands there are, their words and their help, over cyclopts.

It loads no command's work, and no NumPy: help takes a tenth of a second.
"""

import difflib
import inspect
import re
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import NoReturn

from cyclopts import App, Argument, Parameter

from stepbus_orchestrator.plugins import COMMANDS, CommandBroken, named_points

from . import commands
from .options import GROUPS, Command
from .terminal.output import columns, fold, print_error

OWN: dict[str, type[Command]] = {
    row.word(): row
    for row in vars(commands).values()
    if isinstance(row, type) and issubclass(row, Command) and row is not Command
}
"""The commands of the core by name, in the order of the overview; no package replaces one."""
_COMPLETE = "__complete"
"""The scripts of cyclopts call it to complete a word."""
_COLUMN = 24
"""Where the text of an option begins."""
_EXAMPLE = re.compile(r"^\$( .*)", re.MULTILINE)
_ABOUT = (
    "Co-simulation for robotics: plant, controller and mission as separate processes in lockstep "
    "over Zenoh, recorded to MCAP."
)
_ENDING = """stepbus help COMMAND     options and examples of a command
stepbus --version        the version

example: stepbus run two_link"""


def answer(words: Sequence[str]) -> NoReturn:
    """Write the version, a help, or how the last word may go on, and exit."""
    first = words[0] if words else ""
    if first == "--version":
        sys.stdout.write(f"stepbus {import_module('importlib.metadata').version('stepbus')}\n")
    elif first == _COMPLETE:
        app_of(*load_commands())([*words], result_action="return_value")
    elif first in {"", "-h", "--help"}:
        (sys.stdout if first else sys.stderr).write(overview())
    elif first.startswith("-"):
        refuse(f"{first} is not an option of stepbus; write options after the command")
    else:
        try:
            sys.stdout.write(help_page(load_command(first)))
        except CommandBroken as exc:
            print_error(str(exc))
            raise SystemExit(2) from exc
    raise SystemExit(0 if first else 2)


def refuse(message: str, prog: str = "stepbus") -> NoReturn:
    """Print what is wrong with the words that are typed, and exit."""
    end = "" if message.endswith("?") else ";"
    print_error(f"{message.removesuffix('.')}{end} see {prog} --help")
    raise SystemExit(2)


# --- commands ----------------------------------------------------------------------------------


def command_names() -> tuple[str, ...]:
    """Return the names of all commands, in the order of the overview."""
    return tuple(dict.fromkeys((*OWN, *named_points(COMMANDS))))


def load_command(name: str) -> type[Command]:
    """Return a command by name; raises CommandBroken for one of a package that cannot be loaded."""
    if name in OWN:
        return OWN[name]
    if name not in command_names():
        near = difflib.get_close_matches(name, command_names(), 1)
        refuse(f"no command {name!r}" + (f"; did you mean {near[0]!r}?" if near else ""))
    point = named_points(COMMANDS)[name]
    try:
        command: type[Command] = point.load()
    except Exception as exc:
        why = " ".join(str(exc).split())
        raise CommandBroken(
            f"the command {name!r} cannot be loaded from {point.value}: {why}"
        ) from exc
    return command


def load_commands() -> Iterator[type[Command]]:
    """Load all commands that can be loaded, in the order of the overview; name the others."""
    for name in command_names():
        try:
            yield load_command(name)
        except CommandBroken as exc:
            print_error(str(exc))


def app_of(*loaded: type[Command]) -> App:
    """Return the reader of cyclopts for commands."""
    app = App(
        name="stepbus",
        default_parameter=Parameter(negative=(), allow_repeating=True),
        help_flags=(),
        version_flags=(),
    )
    for command in loaded:
        app.command(command.complete(), name=command.word())
    return app


# --- help --------------------------------------------------------------------------------------


def overview() -> str:
    """Return all commands in their groups, a line each."""
    loaded = list(load_commands())
    width = max(len(command.word()) for command in loaded)
    lines: list[str] = []
    for group in GROUPS:
        members = [c for c in loaded if (c.group if c.group in GROUPS else GROUPS[-1]) == group]
        lines += ["", group] if members else []
        lines += [f"  {c.word():{width}}  {summary_of(c)}" for c in members]
    lines += ["", *_ENDING.splitlines()]
    folded = [fold(line, columns(), " " * (width + 2)) for line in lines]
    return "\n".join(["usage: stepbus COMMAND ...", "", fold(_ABOUT, columns()), *folded]) + "\n"


def summary_of(command: type[Command]) -> str:
    """Return the line of a command in the overview, with which its docstring begins."""
    first = (inspect.getdoc(command) or "").partition("\n")[0]
    return first[:1].lower() + first[1:].removesuffix(".")


def examples_of(command: type[Command]) -> list[str]:
    """Return the command lines in the docstring of a command."""
    return _EXAMPLE.findall(inspect.getdoc(command) or "")


def help_page(command: type[Command]) -> str:
    """Return what a command does, its options and its examples."""
    name = command.word()
    arguments = [
        argument
        for argument in app_of(command)[name].assemble_argument_collection(parse_docstring=True)
        # The fields of a group stand for it.
        if not argument.children
    ]
    positional = [argument for argument in arguments if argument.index is not None]
    options = [argument for argument in arguments if argument.index is None]
    description = _EXAMPLE.sub("", inspect.getdoc(command) or "").partition("\n\n")[2]
    usage = [label(option) for option in options if option.required]
    usage += ["[OPTIONS]"] if len(usage) < len(options) else []
    usage += [label(a) if a.required else f"[{label(a)}]" for a in positional]
    blocks = {
        "arguments": [*map(_row, positional)],
        "options": [*map(_row, options), _columns("-h, --help", "show this help and exit")],
        "examples": [f" {line}" for line in examples_of(command)],
    }
    parts = [f"usage: stepbus {name} {' '.join(usage)}", " ".join(description.split())]
    parts += ["\n".join([f"{title}:", *rows]) for title, rows in blocks.items() if rows]
    return fold("\n\n".join(filter(None, parts)), columns()) + "\n"


def label(argument: Argument) -> str:
    """Return how an argument is written."""
    name, choices = argument.name.lstrip("-").upper(), argument.get_choices()
    value = argument.parameter.metavar or (f"{{{','.join(choices)}}}" if choices else name)
    if argument.index is not None:
        return f"{value} ..." if argument.token_count()[1] else value
    return argument.name if argument.hint is bool else f"{argument.name} {value}"


def _row(argument: Argument) -> str:
    text, default = argument.parameter.help or "", argument.field_info.default
    is_shown = isinstance(default, int | float | str) and not isinstance(default, bool)
    if is_shown and default != "" and "default:" not in text:
        text += f" (default: {default})"
    return _columns(label(argument), text)


def _columns(label: str, text: str) -> str:
    """Return a label and its text, below it where the label is long."""
    head, words = f"  {label}", " ".join(text.split())
    if len(head) > _COLUMN - 2:
        return f"{head}\n{fold(' ' * _COLUMN + words, columns())}"
    return fold(f"{head:{_COLUMN}}{words}", columns(), " " * (_COLUMN - 2))


# --- commands of its own -----------------------------------------------------------------------


def help_command(given: commands.Help) -> int:
    """Print the help of a command, or the overview."""
    sys.stdout.write(help_page(load_command(given.command)) if given.command else overview())
    return 0


def completion_command(given: commands.Completion) -> int:
    """Print the completion script of a shell."""
    app = app_of(*load_commands())
    sys.stdout.write(app.generate_completion(shell=given.shell) + "\n")
    return 0
