"""The words of a command, read by cyclopts; its help, and what is wrong with its words."""

import inspect
import re
from collections.abc import Iterator, Sequence
from inspect import BoundArguments
from itertools import zip_longest
from typing import Annotated

from cyclopts import (
    App,
    Argument,
    CycloptsError,
    MissingArgumentError,
    Parameter,
    UnknownOptionError,
    UnusedCliTokensError,
)

from .parameters import GROUP, Command
from .terminal.output import columns, fold

_COLUMN = 24
"""Where the text of an option begins."""
_SECTION = re.compile(r"\n\n(?:Parameters|Examples)\n-+\n")
_EXAMPLE = re.compile(r"^\$( .*)", re.MULTILINE)


def app_of(command: Command) -> App:
    """Return the application of one command."""
    for name, type_of in command.options.items():
        command.function.__annotations__[name] = Annotated[type_of() | None, GROUP]
    app = App(
        name=command.name,
        help=command.summary,
        default_parameter=Parameter(negative=(), allow_repeating=True),
        end_of_options_delimiter="--" if command.rest == "--" else "",
        help_flags=(),
        version_flags=(),
    )
    app.default(command.function)
    return app


def read_words(command: Command, words: Sequence[str]) -> BoundArguments:
    """Return what the words of a command say; raises ValueError with a sentence."""
    try:
        _, bound, _ = app_of(command).parse_args(
            list(_completed(command, words)), print_error=False, exit_on_error=False
        )
    except CycloptsError as exc:
        raise ValueError(_sentence(exc)) from exc
    bound.apply_defaults()
    return bound


def _completed(command: Command, words: Sequence[str]) -> Iterator[str]:
    """Yield words with the values that options may be without, and a program as values."""
    end = words.index(command.rest) if command.rest in words else len(words)
    for word, following in zip_longest(words[:end], words[1:end], fillvalue="-"):
        is_bare = word in command.bare and following.startswith("-")
        yield f"{word}={command.bare[word]}" if is_bare else word
    program = words[end + 1 :]
    if command.rest == "--" or not program:
        yield from words[end:]
    else:
        yield from (f"{command.rest}={word}" for word in program)


def _sentence(error: CycloptsError) -> str:
    error.verbose = False
    if isinstance(error, UnusedCliTokensError):
        return f"unexpected argument {(error.unused_tokens or [''])[0]!r}"
    if isinstance(error, MissingArgumentError) and error.argument:
        lacks = f"{error.keyword} needs a value"
        return lacks if error.keyword else f"{_label(error.argument)} is missing"
    text = str(error)
    if isinstance(error, UnknownOptionError):
        text = text.replace(": ", " ", 1).replace(". Did", "; did")
    return text[:1].lower() + text[1:].removesuffix(".")


def help_page(command: Command) -> str:
    """Return what a command does, its options and examples."""
    arguments = list(app_of(command).assemble_argument_collection(parse_docstring=True))
    positional = [argument for argument in arguments if argument.index is not None]
    # The fields of a group stand for it.
    options = [a for a in arguments if a.index is None and not a.children]
    docstring = inspect.getdoc(command.function) or ""
    description = _SECTION.split(docstring)[0].partition("\n\n")[2]
    usage = [_label(option) for option in options if option.required]
    usage += ["[OPTIONS]"] if len(usage) < len(options) else []
    usage += [_label(a) if a.required else f"[{_label(a)}]" for a in positional]
    blocks = {
        "arguments": [*map(_row, positional)],
        "options": [*map(_row, options), _columns("-h, --help", "show this help and exit")],
        "examples": [f" {line}" for line in _EXAMPLE.findall(docstring)],
    }
    parts = [f"usage: stepbus {command.name} {' '.join(usage)}", " ".join(description.split())]
    parts += ["\n".join([f"{title}:", *rows]) for title, rows in blocks.items() if rows]
    return fold("\n\n".join(filter(None, parts)), columns()) + "\n"


def _label(argument: Argument) -> str:
    """Return how an argument is written."""
    name, choices = argument.name.lstrip("-").upper(), argument.get_choices()
    if argument.index is not None:
        is_last = argument.field_info.kind is inspect.Parameter.VAR_POSITIONAL
        return f"{name} ..." if is_last else name
    value = argument.parameter.metavar or (f"{{{','.join(choices)}}}" if choices else name)
    return argument.name if argument.hint is bool else f"{argument.name} {value}"


def _row(argument: Argument) -> str:
    text, default = argument.parameter.help or "", argument.field_info.default
    has_default = isinstance(default, int | float | str) and not isinstance(default, bool)
    if has_default and default != "" and "default:" not in text:
        text += f" (default: {default})"
    return _columns(_label(argument), text)


def _columns(label: str, text: str) -> str:
    """Return a label and its text, below it where the label is long."""
    head, text = f"  {label}", " ".join(text.split())
    is_long = len(head) > _COLUMN - 2
    return f"{head}\n{'':{_COLUMN}}{text}" if is_long else f"{head:{_COLUMN}}{text}"
