"""User-defined message types, from a YAML file or an installed Python package."""

import importlib
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from stepbus_participant.files import find_file
from stepbus_participant.packages import extra_hint
from stepbus_schemas import Message, Types, class_declaration, error_text, type_name, type_problems

from .problems import Keys, Problems

_KEY = "types"
_EXPECTED = "a message type file has the single key 'types'"

Declarations = dict[str, Mapping[str, Any]]


def load_types(*sources: str | Path) -> Types:
    """Return the message types in YAML files, by path, or in installed modules, by name.

    After `types = load_types("thruster.yaml")`, `types["Thruster/1"]` is a class.
    Raises WiringError that lists every problem.
    """
    declarations: Declarations = {}
    for source in sources:
        problems = Problems(str(source))
        declarations |= read_types(source, problems)
        problems.refuse()
    return Types(declarations)


def is_file_name(source: str | Path) -> bool:
    """Return whether a source of types is a YAML file, and not a module."""
    return isinstance(source, Path) or source.endswith((".yaml", ".yml"))


def read_types(
    source: str | Path | Mapping[str, Any],
    problems: Problems,
    keys: Keys = (),
    folder: Path | None = None,
) -> Declarations:
    """Return the declarations of a map, a YAML file or an installed module, without those amiss.

    problems: what is wrong is added there, at or below `keys`. folder: where a file is looked for;
    None: its name is a path.
    """
    if isinstance(source, Mapping):
        return _checked(source, problems.below(keys))
    if not is_file_name(source):
        return _checked(_of_module(str(source), problems, keys), problems.below(keys))
    path: Path | None = Path(source)
    if folder is not None:
        path = problems.attempt(keys, partial(find_file, str(source), folder))
    return {} if path is None else problems.attempt(keys, partial(_of_file, path)) or {}


def _of_file(path: Path) -> Declarations:
    from .yaml_file import read_yaml  # noqa: PLC0415  a participant may do without YAML

    file = read_yaml(path, _EXPECTED)
    problems = file.problems()
    for key in file.data:
        if key != _KEY:
            problems.add((key,), f"unknown key; {_EXPECTED}")
    declarations = _checked(file.data.get(_KEY), problems.below((_KEY,)))
    problems.refuse()
    return declarations


def _checked(data: object, problems: Problems) -> Declarations:
    """Return what a map of types declares, without what is wrong."""
    declarations: Declarations = {}
    if not isinstance(data, Mapping):
        problems.add((), "must be a map of types: Name/1 → its fields")
        return declarations
    for name, declaration in data.items():
        wrong = list(type_problems(name, declaration))
        for keys, text in wrong:
            problems.add((name, *keys), text)
        if not wrong:
            declarations[name] = declaration
    return declarations


def _of_module(name: str, problems: Problems, keys: Keys) -> Declarations:
    """Return the types of the message classes of an installed module."""
    try:
        module = importlib.import_module(name)
    except (Exception, SystemExit) as exc:  # noqa: BLE001  (importing executes the user's module)
        hint = extra_hint(exc.name or "") if isinstance(exc, ImportError) else ""
        reason = str(exc) if isinstance(exc, ImportError) else error_text(exc)
        text = f"cannot import the message type module {name!r}: {reason}{hint}"
        problems.add(keys, text)
        return {}
    classes = list(_classes(module))
    if not classes:
        text = f"the module {name!r} has no message class; derive one from stepbus.Message"
        problems.add(keys, text)
    rows = [(cls, problems.attempt(keys, partial(class_declaration, cls))) for cls in classes]
    return {type_name(cls): row for cls, row in rows if row is not None}


def _classes(module: Any) -> Iterator[type[Message]]:
    listed = getattr(module, "__all__", None)
    for name, value in vars(module).items():
        is_message = isinstance(value, type) and issubclass(value, Message) and value is not Message
        is_own = value.__module__ == module.__name__ if listed is None and is_message else True
        if is_message and is_own and (listed is None or name in listed):
            yield value
