"""YAML 1.2 as plain data, with the line of each value: the one place where YAML is read."""

import dataclasses
import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, MaxDepthExceededError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from stepbus_participant.files import read_text

from .problems import Keys, Place, Problem, Problems, SettingsError, dotted, refuse_many

_STANDARD = "tag:yaml.org,2002:"
_MOST_VALUES = 50_000
"""Aliases of aliases can stand for billions of values in a few lines."""
_MOST_NODES = 2 * _MOST_VALUES
"""Keys and values as they are written: what is longer is not read to its end."""
_DEEPEST = 100
_TOO_DEEP = f"is nested too deeply: more than {_DEEPEST} levels of maps and lists"

_HINTS = (
    (
        "cannot start any token",
        "indent with spaces, not tabs; a text that starts with this character needs quotes",
    ),
    (
        "mapping values are not allowed",
        "check the indentation; a text that contains ': ' needs quotes",
    ),
    ("expected <block end>", "check the indentation of this line and the lines above"),
    ("could not find expected ':'", "a key needs ': ' after it; check the line above too"),
    ("but got '<stream end>'", "a bracket is not closed"),
    ("unexpected end of stream", "a quote is not closed"),
    ("another document", "a file must hold one document: remove the '---'"),
)
"""Part of a sentence of ruamel's → what to do."""


@dataclass(frozen=True, kw_only=True)
class YamlFile:
    """A YAML map as plain data: str, int, float, bool, None, list, dict with str keys.

    file: name used in messages. places: line of each value. own_problems: what is wrong with it.
    """

    file: str
    data: dict[str, Any]
    places: Mapping[Keys, Place]
    own_problems: tuple[Problem, ...] = ()

    def problems(self) -> Problems:
        """Return a collector with what is wrong so far, which knows the lines."""
        return Problems(self.file, self.places, self.own_problems)

    def refuse(self, rows: Iterable[tuple[Keys, str]]) -> None:
        """Raise SettingsError with what was found wrong at some keys, if it is anything."""
        problems = self.problems()
        for keys, message in rows:
            problems.add(keys, message)
        problems.refuse()


def read_yaml(path: Path, expected: str, *, file: str = "") -> YamlFile:
    """Read a YAML file.

    expected: end of the sentence where it is no map. file: name for messages; default: the path's
    last part. Raises SettingsError when it cannot be read or is no YAML map.
    """
    file = file or path.name
    try:
        text = read_text(path, "utf-8-sig")
    except OSError as exc:
        raise fatal(file, f"cannot be read: {exc.strerror} ({path})") from exc
    except UnicodeDecodeError as exc:
        raise fatal(file, f"is not UTF-8 text (byte {exc.start})") from exc
    conversion = _Conversion(file)
    data = conversion.run(text)
    if not isinstance(data, dict):
        what = "is empty" if data is None else "is not a map"
        raise fatal(file, f"{what}; {expected}")
    return YamlFile(
        file=file, data=data, places=conversion.places, own_problems=tuple(conversion.problems)
    )


def parse_yaml(file: str, text: str) -> Any:
    """Return a YAML value; raises SettingsError when it is none. file: named in messages."""
    conversion = _Conversion(file)
    problems: tuple[Problem, ...] = ()
    try:
        value = conversion.run(text)
    except SettingsError as exc:
        problems = exc.problems
    problems = (*problems, *conversion.problems)
    if problems:
        # The command line has no lines.
        raise SettingsError(dataclasses.replace(problem, line=0) for problem in problems)
    return value


class _TooLong(MarkedYAMLError):
    """A file is not worth reading to its end."""


class _CountingComposer(Composer):
    count = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self.count += 1
        if self.count > _MOST_NODES:
            raise _TooLong(problem_mark=self.parser.peek_event().start_mark)
        return super().compose_node(parent, index)


@contextmanager
def _translated(file: str, text: str) -> Iterator[None]:
    """Raise SettingsError, with what to do, for the errors of ruamel."""
    try:
        yield
    except MarkedYAMLError as exc:
        line = 0 if exc.problem_mark is None else exc.problem_mark.line + 1
        if isinstance(exc, MaxDepthExceededError):
            raise fatal(file, _TOO_DEEP, line) from exc
        if isinstance(exc, _TooLong):
            raise fatal(file, f"has more than {_MOST_NODES} keys and values", line) from exc
        hint = _hint(str(exc.problem), text.splitlines()[line - 1 : line])
        raise fatal(file, f"not YAML: {exc.problem}{hint}", line) from exc
    except YAMLError as exc:
        raise fatal(file, f"not YAML: {str(exc).splitlines()[0]}") from exc


def _hint(problem: str, lines: list[str]) -> str:
    """Return what to do about a problem of ruamel's; lines: the one that it is in, if any."""
    bare = re.search(r"[^\s\"',:{}\[\]]+[\[{][^\]}]*[\]}]", lines[0]) if lines else None
    if problem.startswith("expected ',' or") and bare is not None:
        return f"; put {bare[0]} in quotes: '{bare[0]}'"
    return next((f"; {hint}" for part, hint in _HINTS if part in problem), "")


def fatal(file: str, message: str, line: int = 0) -> SettingsError:
    """Return the error of a file that is not worth reading on."""
    return SettingsError([Problem(file=file, line=line, path="", message=message)])


class _Conversion:
    """Turns one YAML text into plain data."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.places: dict[Keys, Place] = {}
        self.problems: list[Problem] = []
        self._open: list[Node] = []

    def run(self, text: str) -> Any:
        yaml = YAML(typ="safe", pure=True)
        yaml.max_depth, yaml.Composer = _DEEPEST, _CountingComposer
        with _translated(self.file, text):
            root = yaml.compose(io.StringIO(text))
            return None if root is None else self._value(root, ())

    def _value(self, node: Node, keys: Keys) -> Any:
        if any(node is parent for parent in self._open):
            return self._refuse(node, keys, "an alias must not contain itself")
        if len(self.places) > _MOST_VALUES:
            raise fatal(self.file, f"has more than {_MOST_VALUES} values", node.start_mark.line + 1)
        self._open.append(node)
        try:
            return self._content(node, keys)
        finally:
            self._open.pop()

    def _content(self, node: Node, keys: Keys) -> Any:
        tag = str(node.tag).removeprefix(_STANDARD)
        if isinstance(node, MappingNode) and tag == "map":
            return self._map(node, keys)
        if isinstance(node, SequenceNode) and tag == "seq":
            return [self._item(item, (*keys, i), item) for i, item in enumerate(node.value)]
        if isinstance(node, ScalarNode) and tag in _SCALARS:
            try:
                return _SCALARS[tag](node.value)
            except ValueError as exc:
                return self._refuse(node, keys, str(exc))
        return self._refuse(node, keys, f"the tag {node.tag} is not supported")

    def _map(self, node: MappingNode, keys: Keys) -> dict[str, Any]:
        content: dict[str, Any] = {}
        for key, value in node.value:
            name, tag = key.value, str(key.tag).removeprefix(_STANDARD)
            if tag == "merge":
                self._refuse(key, keys, "'<<' is not YAML 1.2; write the keys out, or use extends")
            elif not isinstance(key, ScalarNode) or _SCALARS.get(tag) is not _text:
                shown = name if isinstance(key, ScalarNode) else "a list or map"
                self._refuse(key, keys, f"a key must be text, not {shown}; put it in quotes")
            elif name in content:
                line = self.places[*keys, name].line
                self._refuse(key, (*keys, name), f"is a duplicate key, first in line {line}")
            else:
                content[name] = self._item(value, (*keys, name), key)
        return content

    def _item(self, node: Node, keys: Keys, at: Node) -> Any:
        self.places[keys] = Place(file=self.file, line=at.start_mark.line + 1)
        return self._value(node, keys)

    def _refuse(self, node: Node, keys: Keys, message: str) -> None:
        line = node.start_mark.line + 1
        self.problems.append(Problem(file=self.file, line=line, path=dotted(keys), message=message))
        refuse_many(self.problems)


def _integer(text: str) -> int:
    digits = text.replace("_", "").lower()
    is_based = digits.lstrip("+-")[:2] in {"0x", "0o", "0b"}
    try:
        value = int(digits, 0 if is_based else 10)
    except ValueError as exc:
        raise ValueError(f"{text[:40]!r} is not an integer") from exc
    if not -(2**63) <= value < 2**64:
        raise ValueError(f"the integer {text[:40]} does not fit into 64 bits")
    return value


def _float(text: str) -> float:
    digits = text.replace("_", "").lower()
    try:
        return float(digits.replace(".inf", "inf").replace(".nan", "nan"))
    except ValueError as exc:
        raise ValueError(f"{text[:40]!r} is not a number") from exc


def _text(text: str) -> str:
    try:
        text.encode()
    except UnicodeEncodeError as exc:
        raise ValueError(f"the text {text[:40]!a} is not valid Unicode") from exc
    return text


_SCALARS: Mapping[str, Callable[[str], Any]] = {
    "null": lambda _: None,
    "bool": lambda text: text.lower() in {"true", "yes", "on", "y"},
    "int": _integer,
    "float": _float,
    "str": _text,
    # Dates are no type of YAML 1.2's core schema, nor is '='.
    "timestamp": _text,
    "value": _text,
}
