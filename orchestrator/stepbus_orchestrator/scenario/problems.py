"""What is wrong with a scenario: all of it, each with file, line and path.

WiringError
└─ ScenarioError      lists every problem, one a line
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from stepbus_schemas import WiringError

Keys = tuple[str | int, ...]
"""Where a value stands: the keys and list indices that lead to it."""

_SHOWN_CHARACTERS = 60


@dataclass(frozen=True, kw_only=True, order=True)
class Place:
    """A line of a file, counted from 1; 0 stands for the whole."""

    file: str
    line: int


@dataclass(frozen=True, kw_only=True, order=True)
class Problem:
    """One thing that is wrong: in which line of which file, at which path, and why."""

    file: str
    line: int
    path: str
    message: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        return ": ".join(part for part in (place, self.path, self.message) if part)


class ScenarioError(WiringError):
    """A scenario cannot be run; `problems` has every reason, its text one a line."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(sorted(set(problems)))
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(str(problem) for problem in self.problems)


class Problems:
    """Collects problems and finds the line of each.

    file: named where no line is known. places: of each value of the scenario.
    """

    def __init__(self, file: str, places: Mapping[Keys, Place], found: Iterable[Problem]) -> None:
        self._whole = Place(file=file, line=0)
        self._places = places
        self._found = list(found)

    def add(self, keys: Keys, message: str) -> None:
        """Note that the value at `keys` is wrong."""
        known = (keys[:n] for n in range(len(keys), 0, -1) if keys[:n] in self._places)
        place = self._places.get(next(known, ()), self._whole)
        self._found.append(
            Problem(file=place.file, line=place.line, path=dotted(keys), message=message)
        )

    def refuse(self) -> None:
        """Raise ScenarioError with all problems, if there are any."""
        if self._found:
            raise ScenarioError(self._found)


def dotted(keys: Keys) -> str:
    """Return a path as people write it: `participants.plant.exec[2]`."""
    text = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    return text.removeprefix(".")


def hint(name: str, known: Iterable[str]) -> str:
    """Return `; did you mean 'x'?`, or the known names when none is near."""
    names = list(dict.fromkeys(known))
    near = difflib.get_close_matches(name, names, n=1)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; known: {', '.join(names)}" if names else ""


def show(value: object) -> str:
    """Return a value as an error message shows it."""
    if isinstance(value, dict | list):
        return "a map" if isinstance(value, dict) else "a list"
    if value is None or isinstance(value, bool):
        return {None: "nothing", True: "true", False: "false"}[value]
    text = repr(value)
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}…"
