"""YAML 1.2 as plain data, with the line of each value: the one place where YAML is read."""

import dataclasses
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from stepbus_participant.files import read_text

from .problems import Keys, Place, Problem, Problems, SettingsError

_STANDARD = "tag:yaml.org,2002:"
_TEXTS = ("str", "timestamp", "value")
"""Dates are no type of YAML 1.2's core schema, nor is '='."""
_OTHERS = ("bool", "float", "int")
_MOST_CHARACTERS, _MOST_VALUES = 1_000_000, 50_000
"""Aliases of aliases can stand for billions of values in a few lines."""
_TOO_LARGE = f"has more than {_MOST_CHARACTERS} characters or {_MOST_VALUES} values"
_HINT = "check the indentation, brackets and quotes"


@dataclass(frozen=True, kw_only=True)
class YamlFile:
    """A YAML map as plain data: str, int, float, bool, None, list, dict with str keys.

    file: name used in messages. places: line of each value. own_problems: mistakes in the YAML.
    """

    file: str
    data: dict[str, Any]
    places: Mapping[Keys, Place]
    own_problems: tuple[Problem, ...] = ()

    def problems(self) -> Problems:
        """Return a collector that holds the problems so far and knows the lines."""
        return Problems(self.file, self.places, self.own_problems)

    def refuse(self, rows: Iterable[tuple[Keys, str]]) -> None:
        """Raise SettingsError for (keys, message) pairs, if there are any."""
        problems = self.problems()
        for keys, message in rows:
            problems.add(keys, message)
        problems.refuse()


def read_yaml(path: Path, expected: str, *, file: str = "") -> YamlFile:
    """Read a YAML file.

    expected: end of the message about a file that is no map. file: name for messages; default: the
    last part of the path. Raises SettingsError when it cannot be read or is no YAML map.
    """
    file = file or path.name
    try:
        text = read_text(path, "utf-8-sig")
    except OSError as exc:
        raise fatal(file, f"cannot be read: {exc.strerror} ({path})") from exc
    except UnicodeDecodeError as exc:
        raise fatal(file, f"is not UTF-8 text (byte {exc.start})") from exc
    data, places, problems = _converted(file, text)
    if not isinstance(data, dict):
        what = "is empty" if data is None else "is not a map"
        raise fatal(file, f"{what}; {expected}")
    return YamlFile(file=file, data=deepcopy(data), places=places, own_problems=problems)


@lru_cache(maxsize=64)
def _converted(file: str, text: str) -> tuple[Any, Mapping[Keys, Place], tuple[Problem, ...]]:
    """Return a YAML value, the line of each part, and mistakes: many runs read the same file."""
    conversion = _Conversion(file)
    return conversion.run(text), conversion.places, tuple(conversion.problems)


def parse_yaml(file: str, text: str) -> Any:
    """Return a YAML value; raises SettingsError when it is none. file: named in messages."""
    conversion = _Conversion(file)
    try:
        value = conversion.run(text)
        Problems(problems=conversion.problems).refuse()
    except SettingsError as exc:
        # The command line has no lines.
        raise SettingsError(
            dataclasses.replace(problem, place=Place(file=file)) for problem in exc.problems
        ) from exc
    return value


def fatal(file: str, message: str, line: int = 0) -> SettingsError:
    """Return the error of a file that cannot be read any further."""
    return SettingsError([Problem(place=Place(file=file, line=line), message=message)])


class _Conversion:
    """Turns one YAML text into plain data."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.places: dict[Keys, Place] = {}
        self.problems: list[Problem] = []
        self._yaml = YAML(typ="safe", pure=True)

    def run(self, text: str) -> Any:
        if len(text) > _MOST_CHARACTERS:
            raise fatal(self.file, _TOO_LARGE)
        try:
            root = self._yaml.compose(text)
            return None if root is None else self._value(root, ())
        except MarkedYAMLError as exc:
            line = 0 if exc.problem_mark is None else exc.problem_mark.line + 1
            raise fatal(self.file, f"not YAML: {exc.problem}; {_HINT}", line) from exc
        except YAMLError as exc:
            raise fatal(self.file, f"not YAML: {str(exc).splitlines()[0]}") from exc
        except RecursionError as exc:
            raise fatal(self.file, "is nested too deeply") from exc

    def _value(self, node: Node, keys: Keys) -> Any:
        if len(self.places) > _MOST_VALUES:
            raise fatal(self.file, _TOO_LARGE)
        tag = str(node.tag).removeprefix(_STANDARD)
        if isinstance(node, MappingNode) and tag == "map":
            return self._map(node, keys)
        if isinstance(node, SequenceNode) and tag == "seq":
            return [self._item(item, (*keys, i), item) for i, item in enumerate(node.value)]
        if isinstance(node, ScalarNode):
            return self._scalar(node, tag, keys)
        return self._refuse(node, keys, f"the tag {node.tag} is not supported")

    def _map(self, node: MappingNode, keys: Keys) -> dict[str, Any]:
        content: dict[str, Any] = {}
        for key, value in node.value:
            tag = str(key.tag).removeprefix(_STANDARD)
            if tag == "merge":
                self._refuse(key, keys, "'<<' is not YAML 1.2; write the keys out, or use extends")
            elif not isinstance(key, ScalarNode) or tag not in _TEXTS:
                shown = key.value if isinstance(key, ScalarNode) else "a list or map"
                self._refuse(key, keys, f"a key must be text, not {shown}; put it in quotes")
            elif key.value in content:
                line = self.places[*keys, key.value].line
                self._refuse(key, (*keys, key.value), f"is a duplicate key, first in line {line}")
            else:
                content[key.value] = self._item(value, (*keys, key.value), key)
        return content

    def _item(self, node: Node, keys: Keys, at: Node) -> Any:
        self.places[keys] = self._place(at)
        return self._value(node, keys)

    def _scalar(self, node: ScalarNode, tag: str, keys: Keys) -> Any:
        if tag == "null":
            return None
        if tag not in (*_TEXTS, *_OTHERS):
            return self._refuse(node, keys, f"the tag {node.tag} is not supported")
        try:
            if tag in _TEXTS:
                node.value.encode()
                return node.value
            value = getattr(self._yaml.constructor, f"construct_yaml_{tag}")(node)
        except (LookupError, ValueError):
            return self._refuse(node, keys, f"{node.value[:40]!a} is not a valid {tag}")
        if tag == "int" and not -(2**63) <= value < 2**64:
            return self._refuse(node, keys, f"{node.value[:40]} does not fit into 64 bits")
        return value

    def _refuse(self, node: Node, keys: Keys, message: str) -> None:
        self.problems.append(Problem(place=self._place(node), message=message, keys=keys))

    def _place(self, node: Node) -> Place:
        return Place(file=self.file, line=node.start_mark.line + 1)
