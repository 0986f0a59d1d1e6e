"""`extends`: a scenario as a small file on top of another one."""

from pathlib import Path
from typing import Any

from stepbus_participant import SettingsError, suggest
from stepbus_participant.parameters import Problem, YamlFile, read_yaml, show

from .crowd import check_count, refuse_crowd
from .locate import builtin_names, locate_from
from .merge import merged
from .move import moved
from .template import instantiate

_KEY = "extends"
_EXPECTED = "a scenario has at least name, step and participants"


def read_extended(path: Path) -> YamlFile:
    """Read a scenario file, and below it those it extends.

    Maps are merged, everything else is replaced; a key set to null removes what it would inherit.
    Names of files are rewritten where the other scenario is in another folder. Participants that
    are made from a template have all their keys.
    Raises SettingsError when a file cannot be read or extends itself.
    """
    document = _read(path, path.name, ())
    check_count(document)
    return instantiate(document)


def read_data(path: Path) -> dict[str, Any]:
    """Return what a scenario file says, with those it extends, as plain data; nothing is checked.

    Raises SettingsError as `read_extended`.
    """
    return read_extended(path).data


def _read(path: Path, file: str, above: tuple[Path, ...]) -> YamlFile:
    refuse_crowd(path)
    document = read_yaml(path, _EXPECTED, file=file)
    if _KEY not in document.data:
        return document
    name = document.data[_KEY]
    base = locate_from(name, path.parent) if isinstance(name, str) and name else None
    chain = (*above, path.resolve())
    mistake = _mistake(name, base, path, chain)
    if base is None or mistake is not None:
        line = document.places[_KEY,].line
        problem = Problem(file=file, line=line, path=_KEY, message=mistake or "")
        raise SettingsError([*document.found, problem])
    below = _read(base, base.name if base.parent == path.parent else name, chain)
    return _on_top(document, moved(below, base.parent, path.parent))


def _mistake(name: object, base: Path | None, path: Path, chain: tuple[Path, ...]) -> str | None:
    """Return what is wrong with a base. chain: the files that lead to it."""
    if not isinstance(name, str) or not name:
        return f"must name a scenario, not {show(name)}"
    if base is None:
        others = sorted(item.name for item in path.parent.glob("*.yaml") if item != path)
        known = suggest(name, (*others, *builtin_names()))
        return f"no file {name!r} in {path.parent}, and no built-in scenario{known}"
    if base.resolve() in chain:
        circle = (*chain[chain.index(base.resolve()) :], base)
        return f"a circle: {' → '.join(file.name for file in circle)}"
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
