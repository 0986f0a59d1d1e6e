"""`--set controller.params.kp=80`: one value of a scenario replaced from the command line."""

import contextlib
import dataclasses
from collections.abc import Sequence
from typing import Any

from stepbus_orchestrator.errors import argument
from stepbus_orchestrator.scenario.model import ScenarioFile
from stepbus_orchestrator.scenario.template import without_replaced
from stepbus_participant import SettingsError, suggest
from stepbus_participant.parameters import Keys, Place, Problem, YamlFile, parse_yaml, show
from stepbus_schemas import WiringError

TOP_KEYS = tuple(
    name for name in ScenarioFile.__struct_encode_fields__ if name not in {"extends", "templates"}
)
_MAY_BE_NEW = ("inputs", "outputs", "params")


def override(document: YamlFile, settings: Sequence[str]) -> YamlFile:
    """Return a scenario with settings such as `duration=2s` or `bus.transport=tcp` applied.

    The first part of a path is a key of the scenario or the name of a participant. Values are
    YAML; null removes the key. A setting that cannot be applied becomes a problem of the document.
    """
    data, places, problems = document.data, dict(document.places), list(document.own_problems)
    for setting in settings:
        file = argument("--set", value=setting)
        try:
            keys, value = _parsed(data, setting, file)
            data = _replaced(data, keys, 0, value)
            places = {at: place for at, place in places.items() if at[: len(keys)] != keys}
            places[keys] = Place(file=file, line=0)
        except SettingsError as exc:
            problems += exc.problems
        except WiringError as exc:
            problems.append(Problem(file=file, line=0, path="", message=str(exc)))
    return YamlFile(file=document.file, data=data, places=places, own_problems=tuple(problems))


def add_faults(document: YamlFile, faults: Sequence[str]) -> YamlFile:
    """Return a scenario with the faults of `--fault` behind its own."""
    own = document.data.get("faults")
    first = len(own) if isinstance(own, list) else 0
    if not faults or not (own is None or isinstance(own, list)):
        return document
    places: dict[Keys, Place] = {
        ("faults", first + i): Place(file=argument("--fault", "faults", text), line=0)
        for i, text in enumerate(faults)
    }
    data = {**document.data, "faults": [*(own or []), *faults]}
    return dataclasses.replace(document, data=data, places={**document.places, **places})


def _parsed(data: dict[str, Any], setting: str, file: str) -> tuple[Keys, Any]:
    """Return the full path and the value of a setting."""
    path, equals, text = setting.partition("=")
    parts = [part.strip() for part in path.split(".")]
    if not equals or not all(parts):
        raise WiringError("write KEY=VALUE, e.g. controller.params.kp=80")
    head = parts[0]
    if head not in TOP_KEYS:
        names = data.get("participants")
        names = list(names) if isinstance(names, dict) else []
        if head not in names:
            place = ScenarioFile.elsewhere(head) or _parameter(data, head)
            known = f"; {place}" if place else suggest(head, (*names, *TOP_KEYS))
            raise WiringError(f"no participant and no key {head!r}{known}")
        parts = ["participants", *parts]
    return tuple(parts), parse_yaml(file, text)


def _parameter(data: dict[str, Any], key: str) -> str:
    """Return of which participants a key is a parameter; nothing: of none."""
    rows = data.get("participants")
    paths = [
        f"{name}.params.{key}"
        for name, row in (rows.items() if isinstance(rows, dict) else ())
        if isinstance(row, dict) and isinstance(row.get("params"), dict) and key in row["params"]
    ]
    return f"did you mean {' or '.join(paths)}?" if paths else ""


def _replaced(node: Any, keys: Keys, depth: int, value: Any) -> Any:
    """Return `node`, which stands at `keys[:depth]`, with the value at `keys` replaced."""
    key = str(keys[depth])
    last = depth == len(keys) - 1
    if last and depth == 2 and keys[0] == "participants" and isinstance(node, dict):
        node = without_replaced(node, {key: value})
    if isinstance(node, list):
        index = _index(node, key, keys[:depth])
        inner = value if last else _replaced(node[index], keys, depth + 1, value)
        return [*node[:index], inner, *node[index + 1 :]]
    if not isinstance(node, dict):
        here = ".".join(map(str, keys[:depth]))
        raise WiringError(f"{here} is {show(node)} and has no keys; set it as a whole")
    if last and value is None:
        return {name: item for name, item in node.items() if name != key}
    return {
        **node,
        key: value if last else _replaced(_child(node, keys, depth), keys, depth + 1, value),
    }


def _child(node: dict[str, Any], keys: Keys, depth: int) -> Any:
    """Return the value at `keys[:depth + 1]`; an empty map where one may be left out."""
    key = str(keys[depth])
    if node.get(key) is not None:
        return node[key]
    if _may_be_new(keys[: depth + 1]):
        return {}
    here = ".".join(map(str, keys[:depth])) or "the scenario"
    raise WiringError(f"{here} has no {key!r}{suggest(key, node)}")


def _may_be_new(keys: Keys) -> bool:
    match keys:
        case ("bus",):
            return True
        case ("participants", _, section):
            return section in _MAY_BE_NEW
        case ("participants", _, "params", *_):
            return True
        case _:
            return False


def _index(node: Sequence[Any], key: str, keys: Keys) -> int:
    with contextlib.suppress(ValueError):
        if 0 <= int(key) < len(node):
            return int(key)
    here = ".".join(map(str, keys))
    raise WiringError(f"{here} is a list of {len(node)}; {key!r} is none of its indices")
