"""`extends`: a scenario as a small file on top of another one, in its folder or elsewhere."""

import dataclasses
import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from stepbus_orchestrator.plugins import scenario_reader
from stepbus_orchestrator.scenario.locate import builtin_names, locate_from, package_url
from stepbus_orchestrator.scenario.scenario_files import is_file
from stepbus_participant import SettingsError, file_in, suggest
from stepbus_participant.parameters import Keys, YamlFile, fatal, read_yaml, show
from stepbus_schemas import WiringError

_KEY = "extends"
_EXPECTED = "a scenario needs at least name, step and participants"


def read_extended(path: Path) -> YamlFile:
    """Read a scenario file, and below it those it extends.

    Maps are merged, everything else is replaced; a key set to null removes what it would inherit.
    Names of files are rewritten where the other scenario is in another folder.
    Raises SettingsError when a file cannot be read or extends itself.
    """
    return _read(path, path.name, ())


def _read(path: Path, file: str, above: tuple[Path, ...]) -> YamlFile:
    document = _read_one(path, file)
    if _KEY not in document.data:
        return document
    name = document.data[_KEY]
    chain = (*above, path.resolve())
    base = locate_from(name, path.parent) if isinstance(name, str) and name else None
    if base is None or base.resolve() in chain:
        problems = document.problems()
        problems.add((_KEY,), _mistake(name, base, path, chain))
        raise problems.error()
    below = _read(base, base.name if base.parent == path.parent else name, chain)
    return YamlFile(
        file=document.file,
        data=merged(
            moved(below, base.parent, path.parent).data,
            {key: value for key, value in document.data.items() if key != _KEY},
        ),
        places={**below.places, **document.places},
        own_problems=(*below.own_problems, *document.own_problems),
    )


def _read_one(path: Path, file: str) -> YamlFile:
    """Read a scenario file: YAML, or what another package makes a scenario of."""
    read = scenario_reader(path.name)
    if read is None:
        return read_yaml(path, _EXPECTED, file=file)
    try:
        return YamlFile(file=file, data=read(path), places={})
    except SettingsError:
        raise
    except WiringError as exc:
        raise fatal(file, str(exc)) from exc


def chain(path: Path) -> list[Path]:
    """Return a scenario file, and those it extends, as far as they can be read."""
    found: list[Path] = []
    base: Path | None = path
    while base is not None and base.resolve() not in found:
        found.append(base.resolve())
        try:
            name = _read_one(base, base.name).data.get(_KEY)
        except SettingsError:
            break
        base = locate_from(name, base.parent) if isinstance(name, str) and name else None
    return found


def _mistake(name: object, base: Path | None, path: Path, chain: tuple[Path, ...]) -> str:
    """Return what is wrong with a base. chain: the files that lead to it."""
    if not isinstance(name, str) or not name:
        return f"must name a scenario, not {show(name)}"
    if base is None:
        others = sorted(item.name for item in path.parent.glob("*.yaml") if item != path)
        known = suggest(name, (*others, *builtin_names()))
        return f"no file {name!r} in {path.parent}, and no built-in scenario{known}"
    circle = (*chain[chain.index(base.resolve()) :], base)
    return f"in a cycle: {' → '.join(file.name for file in circle)}"


def moved(document: YamlFile, old: Path, new: Path) -> YamlFile:
    """Return a scenario of one folder with its files named from another one.

    These are in `participant`, `exec`, `params`, `files` and `types`. A file that ships with
    stepbus becomes `package://stepbus_scenarios/…`.
    """
    if old.resolve() == new.resolve():
        return document
    data = dict(document.data)
    if "types" in data:
        data["types"] = _renamed(data["types"], old, new)
    if isinstance(rows := data.get("participants"), dict):
        data["participants"] = {name: _row(row, old, new) for name, row in rows.items()}
    return dataclasses.replace(document, data=data)


def _row(row: Any, old: Path, new: Path) -> Any:
    if not isinstance(row, dict):
        return row
    named = {key: _renamed(row[key], old, new) for key in ("exec", "params") if key in row}
    source, colon, name = str(row.get("participant") or "").rpartition(":")
    if source.endswith(".py"):
        named["participant"] = f"{os.path.relpath(old / source, new)}{colon}{name}"
    if isinstance(row.get("files"), list):
        # Patterns name no file.
        named["files"] = [f"{os.path.relpath(old, new)}/{pattern}" for pattern in row["files"]]
    return {**row, **named}


def _renamed(value: Any, old: Path, new: Path) -> Any:
    """Return a value in which every text that is the name of a file is renamed."""
    return each_text(value, partial(_new_name, old, new))


def participant_rows(scenario: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the participants of a scenario in plain data, by name, as far as they are maps."""
    rows = scenario.get("participants")
    given = rows.items() if isinstance(rows, dict) else ()
    return {str(name): row for name, row in given if isinstance(row, dict)}


def each_text(value: Any, change: Callable[[str], str]) -> Any:
    """Return a value in which every text is changed."""
    if isinstance(value, dict):
        return {key: each_text(item, change) for key, item in value.items()}
    if isinstance(value, list):
        return [each_text(item, change) for item in value]
    return change(value) if isinstance(value, str) else value


def _new_name(old: Path, new: Path, text: str) -> str:
    option, equals, name = text.partition("=")
    if equals and text.startswith("-"):
        return f"{option}={_new_name(old, new, name)}"
    file = file_in(text)
    path = Path(os.path.normpath(old / file))
    if not text or "://" in text or Path(file).is_absolute() or not is_file(path):
        return text
    of_package = package_url(path) if file == text else ""
    name = of_package or os.path.relpath(path, new)
    # A program is looked for on PATH where its name has no folder.
    return (name if "/" in name else f"./{name}") + text.removeprefix(file)


def merged(base: dict[str, Any], top: dict[str, Any], at: Keys = ()) -> dict[str, Any]:
    """Return `base` with `top` over it: maps merged, the rest replaced, null removes.

    at: where both stand in a scenario; a participant is the class or the program of `top`.
    """
    is_row = len(at) == 2 and at[0] == "participants"
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
