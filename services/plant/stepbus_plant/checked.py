"""Turn plain data into frozen types and find all of its mistakes, each with its line."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin

import msgspec
from ruamel.yaml import YAML, MappingNode, Node
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from stepbus_participant.settings import nearest
from stepbus_schemas import WiringError

T = TypeVar("T")
Where = tuple[str, ...]
Problem = tuple[Where, str]

Finite = Annotated[float, msgspec.Meta(ge=-1e300, le=1e300)]
NonNegative = Annotated[float, msgspec.Meta(ge=0, le=1e300)]
Positive = Annotated[float, msgspec.Meta(gt=0, le=1e300)]
Vector3 = tuple[Finite, Finite, Finite]


class Source:
    """A YAML file: its content, and the line of each of its keys.

    data: the mapping it holds, without the keys that are null. Raises WiringError when the file
    cannot be read or is no YAML mapping.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        data, node = _read(path)
        self._lines = dict(_lines((), node))
        if not isinstance(data, Mapping):
            self.refuse([((), "is empty" if data is None else "is no mapping")])
        self.data: dict[str, Any] = data

    def refuse(self, problems: list[Problem]) -> None:
        """Raise one WiringError that lists all problems, if there are any."""
        if problems:
            raise WiringError("\n".join(self._sentence(*problem) for problem in problems))

    def _sentence(self, where: Where, text: str) -> str:
        known = next((where[:n] for n in range(len(where), 0, -1) if where[:n] in self._lines), ())
        line = f":{self._lines[known]}" if known else ""
        return ": ".join(filter(None, (f"{self.path}{line}", ".".join(where), text)))


class Gathered:
    """Tries one thing after the other; lines: what all of them have refused."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def get(self, make: Callable[[], T]) -> T | None:
        """Return what is made, or None where that raises WiringError."""
        try:
            return make()
        except WiringError as exc:
            self.lines += str(exc).splitlines()
            return None


def _read(path: Path) -> tuple[Any, Node | None]:
    """Return a YAML file as plain data, and as the nodes that know their lines."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        yaml = YAML(typ="safe", pure=True)
        return without_nulls(yaml.load(text)), yaml.compose(io.StringIO(text))
    except OSError as exc:
        raise WiringError(f"{path}: cannot be read: {exc.strerror}") from exc
    except UnicodeDecodeError as exc:
        raise WiringError(f"{path}: is not UTF-8 text (byte {exc.start})") from exc
    except YAMLError as exc:
        raise WiringError(f"{path}{_yaml_mistake(exc)}") from exc
    except RecursionError as exc:
        raise WiringError(f"{path}: an alias in it contains itself") from exc


def without_nulls(data: Any) -> Any:
    """Return plain data without the keys whose value is null: those count as absent."""
    if isinstance(data, Mapping):
        return {key: without_nulls(item) for key, item in data.items() if item is not None}
    return data


def _yaml_mistake(exc: YAMLError) -> str:
    if isinstance(exc, MarkedYAMLError) and exc.problem_mark is not None:
        return f":{exc.problem_mark.line + 1}: {exc.problem}"
    return f": is no YAML: {str(exc).splitlines()[0]}"


def _lines(where: Where, node: Node | None) -> Iterator[tuple[Where, int]]:
    if isinstance(node, MappingNode):
        for key, value in node.value:
            path = (*where, str(key.value))
            yield path, key.start_mark.line + 1
            yield from _lines(path, value)


def find_problems(data: object, wanted: Any, where: Where = ()) -> list[Problem]:
    """Return every place where plain data is not what a type wants.

    wanted: a msgspec Struct, `dict[str, Struct]`, an optional one of these, or any type that
    msgspec converts to.
    """
    struct = _struct_of(wanted)
    if struct is not None and isinstance(data, Mapping):
        return _struct_problems(data, struct, where)
    if get_origin(wanted) is dict and isinstance(data, Mapping) and data:
        inner = get_args(wanted)[1]
        return [
            problem
            for key, item in data.items()
            for problem in (
                *_key_problems(key, where),
                *find_problems(item, inner, (*where, str(key))),
            )
        ]
    try:
        msgspec.convert(data, wanted)
    except msgspec.ValidationError as exc:
        return [(where, str(exc).replace("`object`", "a mapping"))]
    return []


def _key_problems(key: object, where: Where) -> list[Problem]:
    text = f"a key must be text, not {key!r}; put it in quotes"
    return [] if isinstance(key, str) else [((*where, str(key)), text)]


def _struct_of(wanted: Any) -> type[msgspec.Struct] | None:
    """Return the Struct that `Struct` or `Struct | None` names."""
    for item in (wanted, *get_args(wanted)):
        if isinstance(item, type) and issubclass(item, msgspec.Struct):
            return item if get_origin(wanted) is not dict else None
    return None


def _struct_problems(
    data: Mapping[Any, object], wanted: type[msgspec.Struct], where: Where
) -> list[Problem]:
    fields = {field.encode_name: field for field in msgspec.structs.fields(wanted)}
    problems: list[Problem] = []
    for key, value in data.items():
        path = (*where, str(key))
        if key in fields:
            problems += find_problems(value, fields[key].type, path)
        else:
            problems.append((path, f"unknown; {nearest(str(key), fields)}"))
    problems += [
        (where, f"{name!r} is missing")
        for name, field in fields.items()
        if field.required and name not in data
    ]
    return problems
