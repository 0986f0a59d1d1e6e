"""`templates`: participants that differ in a few values are written once."""

import dataclasses
import re
from collections.abc import Iterator, Mapping
from typing import Any

from stepbus_participant import suggest
from stepbus_participant.parameters import Keys, Place, Problem, YamlFile, show

from .merge import merged

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
    found, places = list(document.found), dict(document.places)
    if not isinstance(templates, dict):
        found.append(_problem(document, (_TEMPLATES,), f"must be a map, not {show(templates)}"))
        templates = {}
    if not isinstance(rows, dict):
        return dataclasses.replace(document, data=data, found=tuple(found))
    made = {}
    for name, row in rows.items():
        made[name] = row
        if isinstance(row, dict) and (_TEMPLATE in row or _WITH in row):
            instance = _Instance(document, ("participants", name), row, templates)
            made[name] = instance.row()
            found += instance.found
            places = {**dict(instance.places()), **places}
    data["participants"] = made
    return dataclasses.replace(document, data=data, places=places, found=tuple(found))


class _Instance:
    """One participant that is made from a template. found: what is wrong with it."""

    def __init__(
        self, document: YamlFile, keys: Keys, row: Mapping[str, Any], templates: Mapping[str, Any]
    ) -> None:
        self.found: list[Problem] = []
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
        return _PARAMETER.sub(lambda found: str(self._value(found[1])), text)

    def _value(self, name: str) -> Any:
        if name not in self._values and name not in self._used:
            self._add((_WITH,), f"gives template {self._name!r} no {name!r}")
        self._used.add(name)
        return self._values.get(name, "")

    def _add(self, below: Keys, text: str) -> None:
        self.found.append(_problem(self._document, (*self._keys, *below), text))


def _problem(document: YamlFile, keys: Keys, text: str) -> Problem:
    ends = (keys[:n] for n in range(len(keys), 0, -1))
    place = next((document.places[at] for at in ends if at in document.places), None)
    path = ".".join(map(str, keys))
    if place is None:
        return Problem(file=document.file, line=0, path=path, message=text)
    return Problem(file=place.file, line=place.line, path=path, message=text)
