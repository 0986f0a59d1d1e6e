"""One value of a scenario replaced: `--set controller.params.kp=80`, or the same in Python."""

import json
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from stepbus_orchestrator.scenario.extend import each_text, participant_rows, without_replaced
from stepbus_orchestrator.scenario.model import ScenarioFile
from stepbus_orchestrator.scenario.scenario_files import is_file, is_in_environment
from stepbus_participant import SettingsError, file_in, suggest
from stepbus_participant.parameters import Keys, Place, Problem, YamlFile, parse_yaml, show
from stepbus_schemas import Message, WiringError, type_name

Overrides = Mapping[str, Any] | Sequence[str]
"""Path → value, or texts such as `controller.params.kp=80`."""
TOP_KEYS = tuple(name for name in ScenarioFile.__struct_encode_fields__ if name != "extends")
_INDEX = re.compile(r"[0-9]{1,9}")
_OF_NAMES = (("participants",), ("inputs",), ("outputs",))
"""Last keys of maps by name: to change a part of an entry that is not there is a slip."""


def override(
    document: YamlFile, settings: Sequence[str], folder: Path
) -> tuple[YamlFile, tuple[str, ...]]:
    """Return a scenario with settings such as `duration=2s` applied, and the settings.

    The first part of a path is a key of the scenario or the name of a participant. Values are
    YAML; null removes the key. Mistakes in settings become problems of the document. Files are
    named relative to the scenario's folder: only so does a rerun find them in a copy.
    """
    data, places, problems = document.data, dict(document.places), list(document.own_problems)
    named: list[str] = []
    for setting in settings:
        file = f"--set {setting}"
        named.append(setting)
        try:
            keys, given = _parsed(data, setting, file)
            value = named_from(folder, ".".join(map(str, keys)), given)
            named[-1] = _text(setting, given, value)
            data = _replaced(data, (), keys, value)
            places = {at: place for at, place in places.items() if at[: len(keys)] != keys}
            places[keys] = Place(file=file)
        except SettingsError as exc:
            problems += exc.problems
        except WiringError as exc:
            problems.append(Problem(place=Place(file=file), message=str(exc)))
    return replace(document, data=data, places=places, own_problems=tuple(problems)), tuple(named)


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
            raise WiringError(f"no participant or key {head!r}{known}")
        parts = ["participants", *parts]
    return tuple(parts), parse_yaml(file, text)


def _parameter(data: dict[str, Any], key: str) -> str:
    """Return of which participants a key is a parameter; nothing: of none."""
    paths = [
        f"{name}.params.{key}"
        for name, row in participant_rows(data).items()
        if isinstance(row.get("params"), dict) and key in row["params"]
    ]
    return f"did you mean {' or '.join(paths)}?" if paths else ""


def _replaced(node: Any, at: Keys, keys: Keys, value: Any) -> Any:
    """Return `node`, which stands at `at`, with the value at `keys` below it replaced."""
    key, rest = str(keys[0]), keys[1:]
    here = ".".join(map(str, at)) or "the scenario"
    if isinstance(node, list):
        index = int(key) if _INDEX.fullmatch(key) else len(node)
        if index >= len(node):
            raise WiringError(
                f"{here}: no index {key!r}; the list has {len(node)} values, counted from 0"
            )
        new = _replaced(node[index], (*at, key), rest, value) if rest else value
        return [*node[:index], new, *node[index + 1 :]]
    if not isinstance(node, dict):
        raise WiringError(f"{here} is {show(node)} and has no keys; set it as a whole")
    if rest:
        below = node.get(key)
        if below is None and len(at) < 4 and at[-1:] in _OF_NAMES:
            raise WiringError(f"{here} has no {key!r}{suggest(key, node)}")
        return {**node, key: _replaced({} if below is None else below, (*at, key), rest, value)}
    if value is None:
        return {name: item for name, item in node.items() if name != key}
    is_row = len(at) == 2 and at[0] == "participants"
    return {**(without_replaced(node, {key: value}) if is_row else node), key: value}


def named_from_here(setting: str) -> str:
    """Return a setting of the command line, with the whole path of each file of this folder."""
    try:
        value = parse_yaml("", setting.partition("=")[2])
    except SettingsError:
        return setting  # `override` says what is wrong
    return _text(setting, value, _renamed(value, os.path.abspath))


def _text(setting: str, value: Any, changed: Any) -> str:
    """Return a setting with its value changed; the same text where it stays."""
    return setting if changed == value else f"{setting.partition('=')[0]}={yaml_text(changed)}"


def named_from(folder: Path, path: str, value: Any) -> Any:
    """Return the value of a setting, with files relative to the scenario's folder.

    A program of `exec` that is not recorded keeps its path: it is outside the folder, or in a
    virtual environment.
    """
    is_exec = path.endswith((".exec", ".exec.0"))

    def name(file: str) -> str:
        here = Path(file)
        is_far = not here.is_relative_to(folder) or is_in_environment(here)
        stays = not here.is_absolute() or (is_exec and os.access(file, os.X_OK) and is_far)
        return file if stays else os.path.relpath(file, folder)

    return _renamed(value, name)


def _renamed(value: Any, rename: Callable[[str], str]) -> Any:
    """Return a value with other names of the files in it: `world.yaml`, `controller.py:Class`."""

    def change(text: str) -> str:
        file = file_in(text)
        is_path = ("/" in file or Path(file).suffix) and is_file(Path(file))
        return rename(file) + text.removeprefix(file) if is_path else text

    return each_text(value, change)


def override_texts(given: Overrides) -> list[str]:
    """Return overrides as the command line writes them: `path=YAML`."""
    if isinstance(given, Mapping):
        return [f"{path}={yaml_text(value)}" for path, value in given.items()]
    return list(given)


def plain_value(value: Any) -> Any:
    """Return a value as YAML has it: message classes by name, NumPy values and paths as plain ones.

    Anything else is returned as it is.
    """
    if isinstance(value, type) and issubclass(value, Message):
        return type_name(value)
    if isinstance(value, PathLike):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(item) for item in value]
    return value


def yaml_text(value: Any) -> str:
    """Return a value as one line of YAML that reads back as the same value."""
    value = plain_value(value)
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    if isinstance(value, list):
        return f"[{', '.join(map(yaml_text, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{json.dumps(k)}: {yaml_text(v)}' for k, v in value.items())}}}"
    return json.dumps(value)
