"""Options of a command from the function that does it: its signature and its docstring.

A docstring explains parameters as `name: text.`; the first sentence is the help of the option.
"""

import argparse
import inspect
import re
from collections.abc import Callable, Collection, Sequence
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from stepbus_orchestrator.scenario import Overrides

Function = Callable[..., Any]
Special = Callable[[argparse.ArgumentParser], None] | dict[str, Any] | None
"""What an option has that its parameter does not say, as of `add_argument`; or what declares it.

None: it is no option.
"""

_OF_PYTHON = ("observer", "interrupt")
"""Parameters that every command fills in by itself."""


def add_parameters(
    parser: argparse.ArgumentParser,
    function: Function,
    *,
    exclusive: Collection[str] = (),
    **special: Special,
) -> None:
    """Declare the parameters of a function: those without a name are positional, others options.

    exclusive: of which only one may be given. special: by parameter; `flag` is another name.
    """
    hints, texts = get_type_hints(function), parameter_texts(function)
    group = parser.add_mutually_exclusive_group() if exclusive else parser
    for name, parameter in inspect.signature(function).parameters.items():
        given = special.get(name, {})
        if given is None or name in _OF_PYTHON:
            continue
        if not isinstance(given, dict):
            given(parser)
            continue
        row: dict[str, Any] = {"help": texts[name], **_kind(hints[name]), **given}
        if "action" not in row and isinstance(parameter.default, int | str):
            row |= {"default": parameter.default}
            row["help"] += f" (default: {parameter.default})"
        is_positional = parameter.kind is parameter.POSITIONAL_OR_KEYWORD and "flag" not in row
        flag = row.pop("flag", name if is_positional else f"--{name.replace('_', '-')}")
        where = group if name in exclusive else parser
        where.add_argument(flag, **row if is_positional else {"dest": name, **row})


def parameters_of(args: argparse.Namespace, function: Function) -> dict[str, Any]:
    """Return the arguments of a function as they were given; special ones that are there, too."""
    names = inspect.signature(function).parameters
    return {name: value for name, value in vars(args).items() if name in names}


def parameter_texts(function: Function) -> dict[str, str]:
    """Return parameter → the first sentence of what the docstring of a function says of it."""
    names = inspect.signature(function).parameters
    start = re.compile(rf"(?:^|(?<=[.;] ))((?:{'|'.join(names)})(?:, \w+)*): ")
    texts: dict[str, str] = {}
    for paragraph in (inspect.getdoc(function) or "").split("\n\n"):
        parts = start.split(paragraph.replace("\n", " "))
        pairs = zip(parts[1::2], parts[2::2], strict=True)
        for some, text in pairs:
            texts |= dict.fromkeys(some.split(", "), re.split(r"\.(?= [A-Z]| ?$)", text)[0])
    return texts


def _kind(hint: Any) -> dict[str, Any]:
    """Return what `add_argument` needs for a type."""
    if hint == Overrides:
        return {"action": "append", "default": [], "metavar": "PATH=VALUE"}
    if get_origin(hint) is Sequence:
        return {"action": "append", "default": []}
    options = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    if bool in options:
        return {"action": "store_true"}
    for option in options:
        if get_origin(option) is Literal:
            return {"choices": get_args(option)}
        if get_origin(option) is PathLike:
            return {"type": Path}
    return {"type": int} if int in options and str not in options else {}
