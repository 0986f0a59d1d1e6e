"""`templates`: participants that differ in a few values are written once."""

import dataclasses
import re
from collections.abc import Mapping
from typing import Any

from stepbus_participant import Problems, suggest
from stepbus_participant.parameters import Keys, Place, YamlFile, show

_PARAMETER = re.compile(r"\$\{([^{}]*)\}")


def instantiate(document: YamlFile) -> YamlFile:
    """Return a scenario in which each participant with `template` has the keys of that.

    `${name}` in the texts and keys of a template becomes the value that the participant's `with`
    gives to the name; a text that is nothing else takes over its type. The participant's own keys
    are merged over the template's, as by `extends`. What is wrong becomes a problem of the
    document.
    """
    data = dict(document.data)
    templates = data.pop("templates", None) or {}
    problems, places = document.problems(), dict(document.places)
    if not isinstance(templates, dict):
        problems.add(("templates",), f"must be a map, not {show(templates)}")
        templates = {}
    if isinstance(rows := data.get("participants"), dict):
        data["participants"] = {
            name: _instance(("participants", name), row, templates, problems, places)
            if isinstance(row, dict) and not row.keys().isdisjoint({"template", "with"})
            else row
            for name, row in rows.items()
        }
    return dataclasses.replace(
        document, data=data, places=places, own_problems=problems.error().problems
    )


def _instance(
    at: Keys,
    row: Mapping[str, Any],
    templates: Mapping[str, Any],
    problems: Problems,
    places: dict[Keys, Place],
) -> dict[str, Any]:
    """Return the keys of the participant at `at`, and add the places of those of its template."""
    name, values = row.get("template"), row.get("with") or {}
    if not isinstance(values, dict):
        problems.add((*at, "with"), f"must be a map of parameters, not {show(values)}")
        values = {}
    template = templates.get(name) if isinstance(name, str) else None
    own = {key: value for key, value in row.items() if key not in {"template", "with"}}
    if not isinstance(template, dict):
        key = "template" if "template" in row else "with"
        problems.add((*at, key), _mistake(name, templates))
        return own
    filling = _Filling(values)
    result = merged(filling.value(template), own, at)
    for parameter in (parameter for parameter in filling.used if parameter not in values):
        problems.add((*at, "with"), f"lacks {parameter!r}, a parameter of template {name!r}")
    for parameter in (parameter for parameter in values if parameter not in filling.used):
        text = f"template {name!r} has no parameter {parameter!r}{suggest(parameter, filling.used)}"
        problems.add((*at, "with", parameter), text)
    for keys, place in [*places.items()]:
        if keys[:2] == ("templates", name):
            below = (filling.text(key) if isinstance(key, str) else key for key in keys[2:])
            places.setdefault((*at, *below), place)
    return result


def _mistake(name: Any, templates: Mapping[str, Any]) -> str:
    """Return why a name stands for no template."""
    if name is None:
        return "needs a 'template'"
    if not isinstance(name, str):
        return f"must name a template, not {show(name)}"
    if name in templates:
        return f"template {name!r} must be a map, not {show(templates[name])}"
    return f"no template {name!r}{suggest(name, templates)}"


class _Filling:
    """Fills in the parameters of a template. used: those that it has."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.used: dict[str, Any] = {}
        self._values = values

    def value(self, value: Any) -> Any:
        """Return a value of the template with its parameters."""
        if isinstance(value, dict):
            return {self.text(key): self.value(item) for key, item in value.items()}
        if isinstance(value, list):
            return [self.value(item) for item in value]
        if not isinstance(value, str):
            return value
        whole = _PARAMETER.fullmatch(value)
        return self._parameter(whole[1]) if whole else self.text(value)

    def text(self, text: str) -> str:
        """Return a text, or a key, of the template with its parameters."""
        return _PARAMETER.sub(lambda match: str(self._parameter(match[1])), text)

    def _parameter(self, name: str) -> Any:
        return self.used.setdefault(name, self._values.get(name, ""))


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
    left_out = (*("exec", "bridge") * has_class, *("participant",) * has_program)
    return {key: value for key, value in row.items() if key not in left_out}
