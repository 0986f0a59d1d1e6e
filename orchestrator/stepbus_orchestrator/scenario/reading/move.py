"""The files that a scenario names, as they are named from another folder."""

import dataclasses
import os
from pathlib import Path
from typing import Any

from stepbus_participant.parameters import YamlFile

from ..files.paths import is_file
from .locate import package_url

_SECTIONS = ("exec", "params", "with")


def moved(document: YamlFile, old: Path, new: Path) -> YamlFile:
    """Return a scenario of one folder with its files named from another one.

    These are in `exec`, `params`, `with`, `files` and `types`. A file that ships with stepbus
    becomes `package://stepbus_scenarios/…`.
    """
    if old.resolve() == new.resolve():
        return document
    data = dict(document.data)
    if "types" in data:
        data["types"] = _renamed(data["types"], old, new)
    for section in ("participants", "templates"):
        rows = data.get(section)
        if isinstance(rows, dict):
            data[section] = {name: _row(row, old, new) for name, row in rows.items()}
    return dataclasses.replace(document, data=data)


def _row(row: Any, old: Path, new: Path) -> Any:
    if not isinstance(row, dict):
        return row
    row = {k: _renamed(v, old, new) if k in _SECTIONS else v for k, v in row.items()}
    source, colon, name = str(row.get("participant") or "").rpartition(":")
    if source.endswith(".py"):
        row["participant"] = f"{os.path.relpath(old / source, new)}{colon}{name}"
    if isinstance(row.get("files"), list):
        # Patterns name no file.
        row["files"] = [f"{os.path.relpath(old, new)}/{pattern}" for pattern in row["files"]]
    return row


def _renamed(value: Any, old: Path, new: Path) -> Any:
    """Return a value in which every text that is the name of a file is renamed."""
    if isinstance(value, dict):
        return {key: _renamed(item, old, new) for key, item in value.items()}
    if isinstance(value, list):
        return [_renamed(item, old, new) for item in value]
    if not isinstance(value, str):
        return value
    option, equals, name = value.partition("=")
    if equals and value.startswith("-"):
        return f"{option}={_renamed(name, old, new)}"
    is_name = value and "://" not in value and not Path(value).is_absolute()
    return _name(old / value, new) if is_name and is_file(old / value) else value


def _name(file: Path, folder: Path) -> str:
    path = Path(os.path.normpath(file))
    name = package_url(path) or os.path.relpath(path, folder)
    # A program is looked for on PATH where its name has no folder.
    return name if "/" in name else f"./{name}"
