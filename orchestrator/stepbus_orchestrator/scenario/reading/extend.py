"""`extends`: a scenario as a small file on top of another one."""

from pathlib import Path
from typing import Any

from stepbus_participant import SettingsError, suggest
from stepbus_participant.parameters import Problem, YamlFile, read_yaml, show

from ..files.paths import is_file
from .crowd import check_count, refuse_crowd

_KEY = "extends"
_EXPECTED = "a scenario has at least name, step and participants"


def read_extended(path: Path) -> YamlFile:
    """Read a scenario file, and below it those it extends.

    Maps are merged, everything else is replaced; a key set to null removes what it would inherit.
    Raises SettingsError when a file cannot be read or extends itself.
    """
    document = _read(path, ())
    check_count(document)
    return document


def read_data(path: Path) -> dict[str, Any]:
    """Return what a scenario file says, with those it extends, as plain data; nothing is checked.

    Raises SettingsError as `read_extended`.
    """
    return read_extended(path).data


def _read(path: Path, above: tuple[str, ...]) -> YamlFile:
    refuse_crowd(path)
    document = read_yaml(path, _EXPECTED)
    if _KEY not in document.data:
        return document
    base = document.data[_KEY]
    mistake = _mistake(base, path, (*above, path.name))
    if mistake is not None:
        line = document.places[_KEY,].line
        problem = Problem(file=path.name, line=line, path=_KEY, message=mistake)
        raise SettingsError([*document.found, problem])
    return _on_top(document, _read(path.parent / base, (*above, path.name)))


def _mistake(base: object, path: Path, chain: tuple[str, ...]) -> str | None:
    """Return what is wrong with the name of a base. chain: the files that lead to it."""
    if not isinstance(base, str) or not base:
        return f"must name a file, not {show(base)}"
    if base != Path(base).name:
        return f"{base!r} must be in the same folder, since file names are relative to that"
    if base in chain:
        return f"a circle: {' → '.join((*chain[chain.index(base) :], base))}"
    if not is_file(path.parent / base):
        others = sorted(item.name for item in path.parent.glob("*.yaml") if item != path)
        return f"no file {base!r} in {path.parent}{suggest(base, others)}"
    return None


def _on_top(top: YamlFile, base: YamlFile) -> YamlFile:
    """Return the two as one document."""
    own = {key: value for key, value in top.data.items() if key != _KEY}
    return YamlFile(
        file=top.file,
        data=merged(base.data, own),
        places={**base.places, **top.places},
        found=(*base.found, *top.found),
    )


def merged(base: dict[str, Any], top: dict[str, Any]) -> dict[str, Any]:
    """Return `base` with `top` over it: maps merged, the rest replaced, null removes."""
    result = dict(base)
    for key, value in top.items():
        below = base.get(key)
        if value is None:
            result.pop(key, None)
        elif isinstance(value, dict):
            result[key] = merged(below if isinstance(below, dict) else {}, value)
        else:
            result[key] = value
    return result
