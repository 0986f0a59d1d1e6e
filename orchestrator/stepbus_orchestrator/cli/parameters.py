"""How a command is declared: a function, whose signature and docstring are its options and help.

What a command does is in a module of its own, which is loaded when the command runs: its help
takes a tenth of a second, and most commands load NumPy.
"""

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from .overview import MORE

Function = Callable[..., Any]


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command of the command line.

    Attributes
    ----------
    function
        its parameters are those of the command, and its docstring, in numpydoc form, the help
    name
        as typed
    group
        where it stands in the overview
    execute
        `module:name` of the function that does it, which takes the same parameters and returns the
        exit code; blank for `function` itself
    is_run
        whether it runs a scenario: then it ends in time though no reader takes what it prints
    options
        parameter → returns its type, a dataclass, for one that depends on what is installed
    bare
        option that may stand without a value → the value that it then has
    rest
        word from which on all others are those of a program

    """

    function: Function
    name: str
    group: str = MORE
    execute: str = ""
    is_run: bool = False
    options: Mapping[str, Function] = field(default_factory=dict)
    bare: Mapping[str, str] = field(default_factory=dict)
    rest: str = "--"

    @property
    def summary(self) -> str:
        """Return its line in the overview, with which its docstring begins."""
        first = " ".join((inspect.getdoc(self.function) or "").split("\n\n")[0].split())
        return first[:1].lower() + first[1:].removesuffix(".")

    def load(self) -> Function:
        """Return the function that does it; raises ImportError or AttributeError."""
        return imported(self.execute) if self.execute else self.function


def command(**fields: Any) -> Callable[[Function], Command]:
    """Make a function `<name>_command` the command `<name>`.

    Parameters before `/` are positional, those after `*` options; the fields of a dataclass are
    options too.

    Parameters
    ----------
    fields
        of `Command`: at least `group`, and `execute` where it loads more than a little

    """

    def make(function: Function) -> Command:
        return Command(function=function, name=function.__name__.removesuffix("_command"), **fields)

    return make


def later(target: str) -> Function:
    """Return a function that imports `module:name` when it is called."""

    def call(*given: Any, **named: Any) -> Any:
        return imported(target)(*given, **named)

    return call


def imported(target: str) -> Any:
    """Return what `module:name` names."""
    module, _, name = target.partition(":")
    return getattr(import_module(module), name)


# --- what several commands have ----------------------------------------------------------------


def read_by(parse: Callable[[str], Any], **more: Any) -> Parameter:
    """Return a parameter whose text a function reads; it raises ValueError."""
    return Parameter(converter=lambda _type, tokens: parse(tokens[0].value), **more)


def number(
    what: str, least: float, most: float = 1e18, kind: type[int] | type[float] = int
) -> Callable[[str], float]:
    """Return what reads a number within limits; what: others are, in words."""

    def parse(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise ValueError(f"{text!r} is {what}")
        return value

    return parse


_nanoseconds = later("stepbus_participant:parse_duration")
_set = later("stepbus_orchestrator.scenario.override:named_from_here")


def seconds(text: str) -> float:
    """Return a duration such as `10s`, `5min` or `200ms` in [s]."""
    duration_ns: int = _nanoseconds(text)
    return duration_ns * 1e-9


def step_or_time(text: str) -> int | str:
    """Return a step, or the text of a time such as `6s`."""
    if text.isdecimal():
        return int(text)
    try:
        _nanoseconds(text)
    except ValueError as exc:
        raise ValueError(f"{text!r} is neither a step (0 or higher) nor a time such as 6s") from exc
    return text


GROUP = Parameter(name="*")
"""The fields of a dataclass are options of their own."""

Texts = tuple[str, ...]
Names = Annotated[Texts, Parameter(metavar="PARTICIPANT")]
ScenarioName = Annotated[
    str, Parameter(completer=later("stepbus_orchestrator.cli.completion:scenarios"))
]
Set = Annotated[
    Texts,
    Parameter(
        converter=lambda _type, tokens: tuple(_set(token.value) for token in tokens),
        metavar="PATH=VALUE",
    ),
]
Folder = Annotated[Path | None, Parameter(metavar="FOLDER")]
File = Annotated[Path | None, Parameter(metavar="FILE")]
Duration = read_by(seconds, metavar="DURATION")
PortNumber = Annotated[int | None, read_by(number("not a port number (0 to 65535)", 0, 65535))]
FoxglovePort = Annotated[PortNumber, Parameter(metavar="[PORT]")]
