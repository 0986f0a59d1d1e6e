"""`templates`: participants that differ in a few values are written once; not too many."""

import dataclasses
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from stepbus_participant import read_text, suggest
from stepbus_participant.parameters import Keys, Place, Problem, YamlFile, fatal, show

MOST_PARTICIPANTS = 1000
"""Any two have a link, and each participant is a process."""

_PARTICIPANTS = re.compile(r"^participants:[ \t]*(#.*)?$", re.MULTILINE)
_FIRST = re.compile(r"\A(?:[ \t]*(?:#.*)?\n)*( +)\S")


def refuse_crowd(path: Path) -> None:
    """Raise SettingsError for a file with too many participants; what is no such file passes.

    It counts lines, which takes milliseconds; to read 10,000 participants as YAML takes seconds.
    """
    try:
        text = read_text(path, "utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return
    start = _PARTICIPANTS.search(text)
    if start is None:
        return
    # From the line on that is less indented, it is about something else.
    block = re.split(r"^[^\s#]", text[start.end() + 1 :], maxsplit=1, flags=re.MULTILINE)[0]
    first = _FIRST.match(block)
    if first is None:
        return
    keys = re.findall(rf"^{first[1]}[A-Za-z0-9\"'][^:\n]*:", block, re.MULTILINE)
    _check(len(keys), path.name, text.count("\n", 0, start.start()) + 1)


def check_count(document: YamlFile) -> None:
    """Raise SettingsError for too many participants, however they are written."""
    participants = document.data.get("participants")
    if isinstance(participants, dict):
        place = document.places.get(("participants",))
        _check(len(participants), document.file, 0 if place is None else place.line)


def _check(count: int, file: str, line: int) -> None:
    if count > MOST_PARTICIPANTS:
        text = f"has {count} participants; a run has at most {MOST_PARTICIPANTS}"
        raise fatal(file, text, line)


_TEMPLATES, _TEMPLATE, _WITH = "templates", "template", "with"
_PARAMETER = re.compile(r"\$\{([^{}]*)\}")


def instantiate(document: YamlFile) -> YamlFile:
    """Return a scenario in which each participant with `template` has the keys of that.

    `${name}` in the texts and keys of a template becomes the value that the participant's `with`
    gives to the name; a text that is nothing else takes over its type. The participant's own keys
    are merged over the template's, as by `extends`. What is wrong becomes a problem of the
    document.
    """
    data = dict(document.data)
    templates = data.pop(_TEMPLATES, None) or {}
    rows = data.get("participants")
    problems, places = list(document.own_problems), dict(document.places)
    if not isinstance(templates, dict):
        problems.append(_problem(document, (_TEMPLATES,), f"must be a map, not {show(templates)}"))
        templates = {}
    if not isinstance(rows, dict):
        return dataclasses.replace(document, data=data, own_problems=tuple(problems))
    made = {}
    for name, row in rows.items():
        made[name] = row
        if isinstance(row, dict) and (_TEMPLATE in row or _WITH in row):
            instance = _Instance(document, ("participants", name), row, templates)
            made[name] = instance.row()
            problems += instance.problems
            places = {**dict(instance.places()), **places}
    data["participants"] = made
    return dataclasses.replace(document, data=data, places=places, own_problems=tuple(problems))


class _Instance:
    """One participant that is made from a template. problems: what is wrong with it."""

    def __init__(
        self, document: YamlFile, keys: Keys, row: Mapping[str, Any], templates: Mapping[str, Any]
    ) -> None:
        self.problems: list[Problem] = []
        self._document, self._keys, self._row = document, keys, row
        self._name = row.get(_TEMPLATE)
        self._values = row.get(_WITH) or {}
        self._used: set[str] = set()
        self._template = self._chosen(templates)
        if not isinstance(self._values, dict):
            self._add((_WITH,), f"must be a map of parameters, not {show(self._values)}")
            self._values = {}

    def _chosen(self, templates: Mapping[str, Any]) -> Mapping[str, Any]:
        template = templates.get(self._name) if isinstance(self._name, str) else None
        if isinstance(template, dict):
            return template
        if self._name is None:
            text = "needs a 'template'"
        elif not isinstance(self._name, str):
            text = f"must name a template, not {show(self._name)}"
        elif self._name in templates:
            text = f"template {self._name!r} must be a map, not {show(template)}"
        else:
            text = f"no template {self._name!r}{suggest(str(self._name), templates)}"
        self._add((_TEMPLATE if _TEMPLATE in self._row else _WITH,), text)
        return {}

    def row(self) -> dict[str, Any]:
        """Return the participant's keys."""
        own = {key: value for key, value in self._row.items() if key not in {_TEMPLATE, _WITH}}
        filled = self._filled(dict(self._template))
        for name in self._values:
            if name not in self._used and self._template:
                text = f"template {self._name!r} has no parameter {name!r}"
                self._add((_WITH, name), text + suggest(name, self._used))
        return merged(filled, own, self._keys)

    def places(self) -> Iterator[tuple[Keys, Place]]:
        """Yield where the keys of the template are, as keys of the participant."""
        above: Keys = (_TEMPLATES, str(self._name))
        for keys, place in self._document.places.items():
            if keys[:2] == above:
                below = (self._text(key) if isinstance(key, str) else key for key in keys[2:])
                yield (*self._keys, *below), place

    def _filled(self, value: Any) -> Any:
        """Return a value of the template with its parameters."""
        if isinstance(value, dict):
            return {self._text(key): self._filled(item) for key, item in value.items()}
        if isinstance(value, list):
            return [self._filled(item) for item in value]
        if not isinstance(value, str):
            return value
        whole = _PARAMETER.fullmatch(value)
        return self._value(whole[1]) if whole else self._text(value)

    def _text(self, text: str) -> str:
        return _PARAMETER.sub(lambda match: str(self._value(match[1])), text)

    def _value(self, name: str) -> Any:
        if name not in self._values and name not in self._used:
            self._add((_WITH,), f"gives template {self._name!r} no {name!r}")
        self._used.add(name)
        return self._values.get(name, "")

    def _add(self, below: Keys, text: str) -> None:
        self.problems.append(_problem(self._document, (*self._keys, *below), text))


def _problem(document: YamlFile, keys: Keys, text: str) -> Problem:
    ends = (keys[:n] for n in range(len(keys), 0, -1))
    place = next((document.places[at] for at in ends if at in document.places), None)
    path = ".".join(map(str, keys))
    if place is None:
        return Problem(file=document.file, line=0, path=path, message=text)
    return Problem(file=place.file, line=place.line, path=path, message=text)


_PROGRAM = ("exec", "bridge")


def merged(base: dict[str, Any], top: dict[str, Any], at: Keys = ()) -> dict[str, Any]:
    """Return `base` with `top` over it: maps merged, the rest replaced, null removes.

    at: where both stand in a scenario; a participant is the class or the program of `top`.
    """
    is_row = len(at) == 2 and at[0] in {"participants", "templates"}
    result = without_replaced(base, top) if is_row else dict(base)
    for key, value in top.items():
        below = base.get(key)
        if value is None:
            result.pop(key, None)
        elif isinstance(value, dict):
            result[key] = merged(below if isinstance(below, dict) else {}, value, (*at, key))
        else:
            result[key] = value
    return result


def without_replaced(row: Mapping[str, Any], top: Mapping[str, Any]) -> dict[str, Any]:
    """Return a participant without its class or program, where `top` has the other."""
    has_class, has_program = (top.get(key) is not None for key in ("participant", "exec"))
    left_out = (*_PROGRAM * has_class, *("participant",) * has_program)
    return {key: value for key, value in row.items() if key not in left_out}
