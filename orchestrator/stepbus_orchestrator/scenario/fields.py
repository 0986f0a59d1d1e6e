"""A value of a scenario on its way into a type: what is wrong is noted, not raised."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from stepbus_participant.durations import parse_duration
from stepbus_schemas import WiringError

from .problems import Keys, Problems, hint, show

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
_LONGEST_NAME = 64


@dataclass(frozen=True)
class Field:
    """One value, where it stands, and where to note what is wrong with it.

    Each reader returns its `default` for a value that is absent (null) or wrong.
    """

    value: Any
    keys: Keys
    problems: Problems

    @property
    def absent(self) -> bool:
        """Return whether the scenario does not set it."""
        return self.value is None

    @property
    def name(self) -> str:
        """Return the key it stands under."""
        return str(self.keys[-1])

    def wrong(self, message: str) -> None:
        """Note that it is wrong."""
        self.problems.add(self.keys, message)

    def __getitem__(self, key: str) -> Field:
        value = self.value.get(key) if isinstance(self.value, dict) else None
        return Field(value, (*self.keys, key), self.problems)

    def children(self) -> Iterator[Field]:
        """Return the values of a map, in its order."""
        if isinstance(self.value, dict):
            for key in self.value:
                yield self[key]
        elif not self.absent:
            self.wrong(f"must be a map, not {show(self.value)}")

    def check_keys(self, known: Sequence[str], required: Sequence[str] = ()) -> None:
        """Note keys that are unknown or missing, or that this is no map."""
        for child in self.children():
            if child.name not in known:
                child.wrong(f"unknown key {child.name!r}{hint(child.name, known)}")
        for key in required:
            if self[key].absent:
                self.wrong(f"the key {key!r} is missing")

    def check_name(self) -> None:
        """Note that the key it stands under cannot be the name of anything."""
        self._check_name(self.name)

    def _check_name(self, name: str) -> bool:
        good = _NAME.fullmatch(name) is not None and len(name) <= _LONGEST_NAME
        if not good:
            self.wrong(
                f"{name!r} is no name; it takes 1 to {_LONGEST_NAME} letters, digits, '_' and '-', "
                "and begins with a letter or digit"
            )
        return good

    def title(self) -> str:
        """Return a name."""
        text = self.text()
        return text if text and self._check_name(text) else ""

    def text(self, default: str = "") -> str:
        """Return text."""
        if self.absent or isinstance(self.value, str):
            return default if self.absent else str(self.value)
        self.wrong(f"must be text, not {show(self.value)}{_quotes(self.value)}")
        return default

    def texts(self) -> tuple[str, ...]:
        """Return a list of texts."""
        if not isinstance(self.value, list):
            if not self.absent:
                self.wrong(f"must be a list, e.g. [python, main.py], not {show(self.value)}")
            return ()
        items = self.items()
        for item in items:
            if not isinstance(item.value, str) or "\0" in item.value:
                item.wrong(f"must be text, not {show(item.value)}{_quotes(item.value)}")
        return tuple(str(item.value) for item in items)

    def items(self) -> list[Field]:
        """Return the values of a list."""
        if isinstance(self.value, list):
            return [Field(v, (*self.keys, i), self.problems) for i, v in enumerate(self.value)]
        if not self.absent:
            self.wrong(f"must be a list, not {show(self.value)}")
        return []

    def integer(self, default: int, *, least: int = 0, most: int = 2**63 - 1) -> int:
        """Return an integer."""
        if self.absent:
            return default
        if isinstance(self.value, int) and not isinstance(self.value, bool):
            if least <= self.value <= most:
                return self.value
            limit = f"at least {least}" if self.value < least else f"at most {most}"
            self.wrong(f"must be {limit}, not {self.value}")
            return default
        self.wrong(f"must be an integer, not {show(self.value)}")
        return default

    def boolean(self) -> bool | None:
        """Return true, false or, where it is absent, None."""
        if not self.absent and not isinstance(self.value, bool):
            self.wrong(f"must be true or false, not {show(self.value)}")
        return self.value if isinstance(self.value, bool) else None

    def choice(self, options: Iterable[str]) -> str | None:
        """Return one of the options."""
        if self.absent or self.value in (names := list(options)):
            return None if self.absent else str(self.value)
        self.wrong(f"must be {' or '.join(names)}, not {show(self.value)}")
        return None

    def duration_ns(self) -> int | None:
        """Return a duration [ns]."""
        if self.absent:
            return None
        if not isinstance(self.value, str):
            self.wrong(f"must be a duration with a unit, e.g. 5ms, not {show(self.value)}")
            return None
        try:
            return parse_duration(self.value)
        except WiringError as exc:
            self.wrong(str(exc))
            return None


def _quotes(value: object) -> str:
    return "; put it in quotes" if isinstance(value, int | float) else ""
