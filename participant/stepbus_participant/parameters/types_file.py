"""Message types of one's own, from a YAML file or an installed Python package."""

import importlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from stepbus_participant.hints import extra_hint
from stepbus_schemas import (
    Message,
    Types,
    WiringError,
    class_declaration,
    error_text,
    type_name,
    type_problems,
)

from .problems import Keys

_KEY = "types"
_EXPECTED = "a file of message types has the key 'types'"

Found = tuple[dict[str, Mapping[str, Any]], list[tuple[Keys, str]]]
"""Declarations by name, of types that are fine, and what is wrong with the others."""


def load_types(*sources: str | Path) -> Types:
    """Return the message types of YAML files, by path, or of installed modules, by name.

    `types = load_types("thruster.yaml")`; `types["Thruster/1"]` then is a class.
    Raises WiringError that lists every problem.
    """
    declarations: dict[str, Mapping[str, Any]] = {}
    for source in sources:
        if is_file_name(source):
            declarations |= read_types_file(Path(source))
            continue
        rows, problems = module_types(str(source))
        if problems:
            texts = [".".join((*map(str, keys), "")).rstrip(".") + f": {t}" for keys, t in problems]
            raise WiringError("\n".join(f"{source}: {text.removeprefix(': ')}" for text in texts))
        declarations |= rows
    return Types(declarations)


def is_file_name(source: str | Path) -> bool:
    """Return whether a source of types is a YAML file, and not a module."""
    return isinstance(source, Path) or source.endswith((".yaml", ".yml"))


def read_types_file(path: Path) -> dict[str, Mapping[str, Any]]:
    """Return the declarations in a YAML file; raises SettingsError with all problems, by line."""
    from .yaml_file import read_yaml  # noqa: PLC0415  a participant may do without YAML

    file = read_yaml(path, _EXPECTED)
    rows, problems = declarations_in(file.data.get(_KEY))
    unknown = [((key,), f"unknown key; {_EXPECTED}") for key in file.data if key != _KEY]
    file.refuse([*unknown, *(((_KEY, *keys), text) for keys, text in problems)])
    return rows


def declarations_in(data: object) -> Found:
    """Return what a map of types declares."""
    if not isinstance(data, Mapping):
        return {}, [((), "must be a map of types: Name/1 → its fields")]
    wrong = [
        ((name, *keys), text)
        for name in data
        for keys, text in (*type_problems(name, data[name]), *_unit_problems(data[name]))
    ]
    names = {keys[0] for keys, _ in wrong}
    return {name: row for name, row in data.items() if name not in names}, wrong


def _unit_problems(declaration: object) -> Iterator[tuple[Keys, str]]:
    """Yield units that nobody knows; a type of a recording may have them all the same."""
    from stepbus_schemas import unit_problem  # noqa: PLC0415  a participant needs no units

    for field, row in declaration.items() if isinstance(declaration, Mapping) else ():
        unit = row.get("unit") if isinstance(row, Mapping) else None
        problem = unit_problem(unit) if isinstance(unit, str) else ""
        if problem:
            yield (field, "unit"), problem


def module_types(name: str) -> Found:
    """Return the types of the message classes of an installed module."""
    try:
        module = importlib.import_module(name)
    except (Exception, SystemExit) as exc:  # noqa: BLE001  (importing executes the user's module)
        hint = extra_hint(exc.name or "") if isinstance(exc, ImportError) else ""
        reason = str(exc) if isinstance(exc, ImportError) else error_text(exc)
        text = f"the module {name!r} of message types cannot be imported: {reason}{hint}"
        return {}, [((), text)]
    data, wrong = {}, []
    for cls in _classes(module):
        try:
            data[type_name(cls)] = class_declaration(cls)
        except WiringError as exc:
            wrong.append(((), str(exc)))
    if not data and not wrong:
        wrong = [((), f"the module {name!r} has no message class; derive one of stepbus.Message")]
    rows, more = declarations_in(data)
    return rows, [*wrong, *more]


def _classes(module: Any) -> Iterator[type[Message]]:
    listed = getattr(module, "__all__", None)
    for name, value in vars(module).items():
        is_message = isinstance(value, type) and issubclass(value, Message) and value is not Message
        is_own = value.__module__ == module.__name__ if listed is None and is_message else True
        if is_message and is_own and (listed is None or name in listed):
            yield value
