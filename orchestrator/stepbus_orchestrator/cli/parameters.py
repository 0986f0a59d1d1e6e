"""A command is a function: its signature and its docstring are its options and its help.

The docstring begins with the line of the overview and a description. Behind them are the
parameters, `name: text.` each, of which the first sentence is the help of the option, and examples.
"""

import argparse
import ast
import inspect
import math
import re
import sys
import textwrap
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from os import PathLike
from pathlib import Path
from types import MappingProxyType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from stepbus_orchestrator.cli.overview import MORE, summary_in
from stepbus_orchestrator.cli.terminal.output import Answer
from stepbus_orchestrator.scenario.override import named_from_here
from stepbus_participant import parse_duration
from stepbus_schemas import WiringError

Function = Callable[..., Any]

COMPLETIONS: Mapping[str, Mapping[str, str]] = {
    kind: {"bash": name, "zsh": name, "fish": f"({name})"}
    for kind in ("command", "recording", "scenario")
    for name in (f"_stepbus_glob_{kind}s",)
}
"""What an argument is completed with, as `complete` of `Annotated` names it → its function in each
shell, which `completion.py` writes. Beside them there are `file` and `directory`."""

_OF_PYTHON = ("observer", "interrupt")
"""Parameters that every command fills in by itself."""
_EXAMPLE = "$ "
_NO_DOCSTRINGS = 2
"""Level of optimisation (`-OO`) from which Python keeps no docstrings."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """One subcommand.

    name: as typed. group: where it stands in the overview. summary: one line in the overview.
    description: above its own help. examples: command lines that work. add_arguments: declares its
    arguments. execute: does it and returns the exit code; errors are raised. is_run: runs a
    scenario, and ends in time though no reader takes what it prints.
    """

    name: str
    summary: str
    description: str
    examples: Sequence[str]
    add_arguments: Callable[[argparse.ArgumentParser], None]
    execute: Callable[[argparse.Namespace], int]
    is_run: bool = False
    group: str = MORE


@dataclass(frozen=True)
class _Row:
    """A parameter, with its type, what the docstring says of it, and more for `add_argument`."""

    parameter: inspect.Parameter
    hint: Any
    text: str
    special: Mapping[str, Any]


def command(
    *,
    group: str = MORE,
    of: Function | None = None,
    hidden: Collection[str] = (),
    exclusive: Collection[str] = (),
    is_run: bool = False,
    **special: Mapping[str, Any],
) -> Callable[[Function], Command]:
    """Make a function `<name>_command` the command `<name>`.

    Parameters that need no name are positional, the others options; those of a dataclass are a
    group of options. `Annotated` has what `add_argument` takes beside the type, with `flag` as
    another name and `complete`, what a shell completes it with. What it returns is an exit code, or
    its `Answer`, which `--json` prints whole.

    group: where it stands in the overview. of: the function that the command is about: its
    parameters, but for `hidden` ones, are those of the command too, and arrive in `**given` where
    the command has none of that name. special: what `Annotated` would have for these. exclusive: of
    which only one may be given.
    """

    def make(function: Function) -> Command:
        rows = _rows((of, function) if of else (function,), hidden, special)
        summary, description, examples = _help(function)
        has_answer = get_type_hints(function)["return"] is Answer

        def add_arguments(parser: argparse.ArgumentParser) -> None:
            group = parser.add_mutually_exclusive_group() if exclusive else parser
            for name, row in rows.items():
                _declare(group if name in exclusive else parser, name, row)
            if has_answer and "json" not in rows:
                parser.add_argument("--json", action="store_true", help=JSON_HELP)

        def execute(args: argparse.Namespace) -> int:
            answer = function(**{name: _value(vars(args), name, rows[name].hint) for name in rows})
            return answer.show(as_json=args.json) if has_answer else int(answer)

        return Command(
            name=function.__name__.removesuffix("_command"),
            summary=summary,
            description=description,
            examples=examples,
            add_arguments=add_arguments,
            execute=execute,
            is_run=is_run,
            group=group,
        )

    return make


def _rows(
    functions: Sequence[Function],
    hidden: Collection[str] = (),
    special: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> dict[str, _Row]:
    """Return the parameters of functions by name; those of a later one replace others."""
    rows: dict[str, _Row] = {}
    for function in functions:
        hints, texts = get_type_hints(function, include_extras=True), parameter_texts(function)
        for name, parameter in inspect.signature(function).parameters.items():
            if parameter.kind is not parameter.VAR_KEYWORD and name not in (*_OF_PYTHON, *hidden):
                text = texts.get(name) or (rows[name].text if name in rows else "")
                rows[name] = _Row(parameter, hints[name], text, special.get(name, {}))
    return rows


def _value(given: Mapping[str, Any], name: str, hint: Any) -> Any:
    """Return the value of a parameter from those of the options."""
    if not is_dataclass(hint):
        return given[name]
    group: Any = hint
    return group(**{field: given[field] for field in inspect.signature(group).parameters})


def _declare(parser: Any, name: str, row: _Row) -> None:
    """Declare a parameter, or all of its group."""
    if is_dataclass(row.hint):
        group: Any = row.hint
        for field, item in _rows([group]).items():
            _declare(parser, field, item)
        return
    default = row.parameter.default
    keywords = _keywords(name, row)
    is_shown = isinstance(default, int | float | str) and default != "" and "action" not in keywords
    if is_shown and "default:" not in keywords["help"]:
        keywords["help"] += f" (default: {default})"
    complete = keywords.pop("complete", "")
    if complete == "file" and keywords.get("metavar") == "FOLDER":
        complete = "directory"
    flag = keywords.pop("flag", "")
    action = (
        parser.add_argument(flag, dest=name, **keywords)
        if flag
        else parser.add_argument(name, **keywords)
    )
    if complete:
        # shtab reads it.
        action.complete = COMPLETIONS.get(complete, complete)


def _keywords(name: str, row: _Row) -> dict[str, Any]:
    """Return what `add_argument` takes for a parameter; flag: where it is no positional one."""
    is_annotated = get_origin(row.hint) is Annotated
    hint, *annotated = get_args(row.hint) if is_annotated else (row.hint,)
    types = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    many = next((option for option in types if get_origin(option) is Sequence), None)
    default = row.parameter.default
    keywords = _kind(get_args(many) if many else types)
    if row.parameter.kind is not row.parameter.POSITIONAL_OR_KEYWORD:
        keywords["flag"] = f"--{name.replace('_', '-')}"
    for extra in (*annotated, row.special):
        keywords |= extra
    is_option = "flag" in keywords
    usual: dict[str, Any]
    if many:
        usual = {"default": [], **({"action": "append"} if is_option else {"nargs": "*"})}
        if any(get_origin(option) is Mapping for option in types):
            usual |= {"metavar": "PATH=VALUE", "type": named_from_here}
    elif bool in types:
        usual = {"action": "store_false" if default is True else "store_true"}
    elif default is not row.parameter.empty:
        usual = {"default": default, **({} if is_option else {"nargs": "?"})}
    else:
        usual = {"required": True} if is_option else {}
    return usual | keywords | ({"help": row.text} if row.text and "help" not in row.special else {})


def _kind(types: Collection[Any]) -> dict[str, Any]:
    """Return how a value of one of these types is read."""
    for option in types:
        if get_origin(option) is Literal:
            return {"choices": get_args(option)}
        if option is Path or get_origin(option) is PathLike:
            return {"type": Path, "complete": "file"}
    if str in types:
        return {}
    return next(({"type": number} for number in (int, float) if number in types), {})


def parameter_texts(function: Function) -> dict[str, str]:
    """Return parameter → the first sentence of what the docstring of a function says of it."""
    texts: dict[str, str] = {}
    for paragraph in _paragraphs(function):
        parts = _start_of_text(function).split(paragraph)
        for names, text in zip(parts[1::2], parts[2::2], strict=True):
            texts |= dict.fromkeys(names.split(", "), re.split(r"\.(?= [A-Z]| ?$)", text)[0])
    return texts


def _help(function: Function) -> tuple[str, str, list[str]]:
    """Return the summary, the description and the examples of a command."""
    summary, *others = _paragraphs(function)
    start = _start_of_text(function)
    texts = [p for p in others if not (p.startswith(_EXAMPLE) or start.match(p))]
    examples = [p for p in others if p.startswith(_EXAMPLE)]
    lines = [line for p in examples for line in f" {p}".split(f" {_EXAMPLE}")[1:]]
    return summary_in(summary), "\n\n".join(texts), lines


def _paragraphs(function: Function) -> list[str]:
    return [" ".join(p.split()) for p in _docstring(function).split("\n\n")]


def _docstring(of: Function) -> str:
    """Return the docstring of a function or a class, also where `python -OO` has left it out."""
    if sys.flags.optimize < _NO_DOCSTRINGS:
        return inspect.getdoc(of) or ""
    try:
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(of))).body
    except OSError:  # made while the program runs, without a source
        return ""
    if isinstance(definition, ast.FunctionDef | ast.ClassDef):
        return ast.get_docstring(definition) or ""
    return ""


def _start_of_text(function: Function) -> re.Pattern[str]:
    names = "|".join(inspect.signature(function).parameters)
    return re.compile(rf"(?:^|(?<=[.;] ))((?:{names})(?:, \w+)*): ")


# --- what several commands have ----------------------------------------------------------------


def number(
    what: str, least: float, most: float = 1e18, kind: type[int] | type[float] = int
) -> Callable[[str], float]:
    """Return the type of an argument that is a number within limits; what: others are, in words."""

    def parse(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{text!r} is {what}")
        return value

    return parse


def seconds(text: str) -> float:
    """Return a duration such as `10s`, `5min` or `200ms` in [s]; the type of such an argument."""
    try:
        return parse_duration(text) * 1e-9
    except WiringError as exc:
        raise argparse.ArgumentTypeError(str(exc)) from exc


DURATION = {"type": seconds, "metavar": "DURATION"}


def step_or_time(text: str) -> int | str:
    """Return a step, or the text of a time such as `6s`; the type of such an argument."""
    if text.isdecimal():
        return int(text)
    try:
        parse_duration(text)
    except WiringError as exc:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither a step (0 or higher) nor a time such as 6s"
        ) from exc
    return text


JSON_HELP = "print the result as JSON only"
Json = Annotated[bool, {"help": JSON_HELP}]

ScenarioName = Annotated[
    str,
    {
        "help": (
            "a scenario file, a folder with a scenario.yaml, or a built-in scenario such as "
            "two_link or two_link/pd"
        ),
        "complete": "scenario",
    },
]
Set = Annotated[
    Sequence[str],
    {
        "metavar": "PATH=VALUE",
        "type": named_from_here,
        "help": "override one value, e.g. controller.params.kp=80 or duration=2s; may be repeated",
    },
]
RECORDING = {"complete": "recording"}
RecordingPath = Annotated[Path, {"help": "a run.mcap, or the folder of its run", **RECORDING}]
Folder = Annotated[Path | None, {"metavar": "FOLDER"}]
File = Annotated[Path | None, {"metavar": "FILE"}]
Trust = Annotated[
    bool,
    {"help": "start the recorded programs without asking, even if they are not in your work tree"},
]
PortNumber = Annotated[int | None, {"type": number("not a port number (0 to 65535)", 0, 65535)}]
FoxglovePort = Annotated[
    PortNumber,
    {
        "nargs": "?",
        "const": 0,
        "metavar": "PORT",
        "help": "stream to Foxglove or Lichtblick over a WebSocket (default: any free port)",
    },
]
