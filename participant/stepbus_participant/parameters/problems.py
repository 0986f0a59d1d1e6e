"""All problems of a configuration, each with file, line and path."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from stepbus_schemas import WiringError

Keys = tuple[str | int, ...]
"""Where a value stands: the keys and list indices that lead to it."""

_T = TypeVar("_T")
_SHOWN_CHARACTERS = 60


@dataclass(frozen=True, kw_only=True)
class Place:
    """A line of a file, counted from 1; 0 stands for the entire file."""

    file: str
    line: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}" if self.line else self.file


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One mistake: its place, the keys that lead to it, and the message."""

    place: Place
    message: str
    keys: Keys = ()

    @property
    def path(self) -> str:
        """The keys as text: `participants.plant.exec[2]`."""
        text = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in self.keys)
        return text.removeprefix(".")

    def __str__(self) -> str:
        return ": ".join(part for part in (str(self.place), self.path, self.message) if part)


class SettingsError(WiringError):
    """A configuration is invalid; `problems` has every reason, the text one per line."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        different = dict.fromkeys(problems)
        self.problems = tuple(sorted(different, key=lambda p: (p.place.file, p.place.line)))
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(map(str, self.problems))


class Problems:
    """Collects problems and finds the line of each.

    file: named where no line is known. places: of each value of the file. above: keys that lead to
    the part that is being read, such as `("participants", "plant", "params")`.
    """

    def __init__(
        self,
        file: str = "",
        places: Mapping[Keys, Place] | None = None,
        problems: Iterable[Problem] = (),
        *,
        above: Keys = (),
    ) -> None:
        self._file_place = Place(file=file)
        self._places = places or {}
        self.above = above
        self._problems: list[Problem] = []
        # A scenario may have thousands of problems.
        self._with_problems: set[Keys] = set()
        self._extend(problems)

    def __len__(self) -> int:
        return len(self._problems)

    def has(self, keys: Keys) -> bool:
        """Return whether there is a problem at or below `keys`."""
        return (*self.above, *keys) in self._with_problems

    def add(self, keys: Keys, message: str) -> None:
        """Add a problem of the value at `keys`."""
        keys = (*self.above, *keys)
        known = (keys[:n] for n in range(len(keys), 0, -1) if keys[:n] in self._places)
        place = self._places.get(next(known, ()), self._file_place)
        self._extend([Problem(place=place, message=message, keys=keys)])

    def add_error(self, keys: Keys, error: WiringError) -> None:
        """Add every line of an error at `keys`; the problems of a SettingsError as they are."""
        if isinstance(error, SettingsError):
            self._extend(error.problems)
        else:
            for line in str(error).splitlines():
                self.add(keys, line)

    def attempt(self, keys: Keys, make: Callable[[], _T]) -> _T | None:
        """Return the result of a call; on WiringError, add it at `keys` and return None."""
        try:
            return make()
        except WiringError as exc:
            self.add_error(keys, exc)
            return None

    def below(self, above: Keys) -> Problems:
        """Return a collector for the part below some keys; its problems are added here too."""
        part = Problems(self._file_place.file, self._places, above=(*self.above, *above))
        part._problems, part._with_problems = self._problems, self._with_problems
        return part

    def refuse(self) -> None:
        """Raise SettingsError with all problems, if there are any."""
        if self._problems:
            raise self.error()

    def error(self) -> SettingsError:
        """Return all problems as one error."""
        return SettingsError(self._problems)

    def _extend(self, problems: Iterable[Problem]) -> None:
        for problem in problems:
            self._problems.append(problem)
            self._with_problems |= {problem.keys[:n] for n in range(len(problem.keys) + 1)}


def show(value: object) -> str:
    """Return a value as shown in error messages."""
    if isinstance(value, Mapping):
        return "a map"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if value is None or isinstance(value, bool):
        return {None: "nothing", True: "true", False: "false"}[value]
    text = repr(value)
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}…"
