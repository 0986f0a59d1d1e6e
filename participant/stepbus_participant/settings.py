"""Read what the scenario says about one participant, and list all that is wrong with it at once."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NoReturn

from stepbus_schemas import InputConfig, OutputConfig, WiringError

from .config import Config

Bound = Literal["any", "not negative", "positive"]


class Noted(WiringError):
    """What is wrong has been noted in the settings; there is nothing to go on with."""


class Settings:
    """The parameters and ports of a participant, read with checks.

    Every reader notes what is wrong and returns something of the right type, so that reading goes
    on; `check` raises one WiringError with all that was noted. A reader without a default wants
    its parameter to be there. folder: what relative file names are relative to.
    """

    def __init__(self, config: Config) -> None:
        self.folder = config.folder
        self._config = config
        self._where = f"participants.{config.name}"
        self._read: dict[str, None] = {}
        self._problems: list[str] = []

    def note(self, param: str, problem: str) -> None:
        """Note what is wrong with a parameter."""
        self._problems.append(f"{self._where}.params.{param}: {problem}")

    def note_all(self, problems: Iterable[str]) -> None:
        """Note whole sentences, which name their place themselves."""
        self._problems.extend(problems)

    def has(self, param: str) -> bool:
        """Return whether the scenario sets a parameter."""
        return self._config.params.get(param) is not None

    def value(self, param: str, default: Any = None) -> Any:
        """Return a parameter as it stands in the scenario; None: it is missing."""
        self._read[param] = None
        value = self._config.params.get(param)
        if value is None:
            value = default
        if value is None:
            self.note(param, "is missing")
        return value

    def number(self, param: str, default: float | None = None, *, bound: Bound = "any") -> float:
        """Return a finite number."""
        value = self.value(param, default)
        return 0.0 if value is None else self.as_number(param, value, bound)

    def as_number(self, where: str, value: Any, bound: Bound = "any") -> float:
        """Return a value as a finite number; where: its place."""
        number = _as_float(value)
        if not math.isfinite(number):
            self.note(where, f"is {value!r}, not a finite number")
            return 0.0
        if (bound == "positive" and value <= 0) or (bound == "not negative" and value < 0):
            self.note(where, f"is {value!r}, has to be {bound}")
        return number

    def flag(self, param: str, default: bool) -> bool:
        """Return true or false."""
        value = self.value(param, default)
        if not isinstance(value, bool):
            self.note(param, f"is {value!r}, neither true nor false")
        return value is True

    def choice(self, param: str, choices: Iterable[str], default: str | None = None) -> str:
        """Return one of several words; the first of them where the scenario's is none of them."""
        words = list(choices)
        value = self.value(param, default)
        if value not in words:
            if value is not None:
                self.note(param, f"is {value!r}; {nearest(str(value), words)}")
            return words[0]
        return str(value)

    def names(self, param: str) -> tuple[str, ...]:
        """Return a list of different names."""
        value = self.value(param)
        if value is None:
            return ()
        if not isinstance(value, list | tuple) or not all(isinstance(v, str) and v for v in value):
            self.note(param, f"is {value!r}, not a list of names")
            return ()
        twice = [name for name in dict.fromkeys(value) if value.count(name) > 1]
        if twice or not value:
            self.note(param, f"names {', '.join(twice)} twice" if twice else "is empty")
        return tuple(dict.fromkeys(value))

    def per_name(
        self,
        param: str,
        names: Sequence[str],
        default: float | None = None,
        *,
        bound: Bound = "any",
    ) -> list[float]:
        """Return one finite number per name: from one for all, a list, or a map by name."""
        value = self.value(param, default)
        return [0.0] * len(names) if value is None else self.as_vector(param, value, names, bound)

    def as_vector(
        self, where: str, value: Any, names: Sequence[str], bound: Bound = "any"
    ) -> list[float]:
        """Return one finite number per name out of a value; where: its place."""
        if isinstance(value, Mapping):
            value = self._by_name(where, value, names)
        elif not isinstance(value, list | tuple):
            return [self.as_number(where, value, bound)] * len(names)
        elif len(value) != len(names):
            wanted = f"{len(names)} ({', '.join(names)})"
            self.note(where, f"has {len(value)} numbers, not {wanted}")
            value = [0.0] * len(names)
        return [
            self.as_number(f"{where}.{name}", item, bound)
            for name, item in zip(names, value, strict=True)
        ]

    def _by_name(self, where: str, value: Mapping[str, Any], names: Sequence[str]) -> list[Any]:
        for name in value:
            if name not in names:
                self.note(where, f"{name!r} is unknown; {nearest(str(name), names)}")
        for name in names:
            if name not in value:
                self.note(where, f"{name!r} is missing")
        return [value.get(name, 0.0) for name in names]

    def file(self, param: str) -> Path | None:
        """Return the file a parameter names, or None where that cannot be."""
        value = self.value(param)
        if not isinstance(value, str):
            if value is not None:
                self.note(param, f"is {value!r}, not a file name")
            return None
        try:
            return self._config.path(value)
        except WiringError as exc:
            self._problems.append(str(exc))
            return None

    def input_of(self, type_name: str) -> str:
        """Return the one input of a message type."""
        return self._port("inputs", self._config.inputs, type_name)

    def output_of(self, type_name: str) -> str:
        """Return the one output of a message type."""
        return self._port("outputs", self._config.outputs, type_name)

    def optional_output_of(self, type_name: str) -> str | None:
        """Return the one output of a message type, or None where the scenario has none."""
        if any(port.type == type_name for port in self._config.outputs.values()):
            return self.output_of(type_name)
        return None

    def _port(
        self, kind: str, ports: Mapping[str, InputConfig] | Mapping[str, OutputConfig], wanted: str
    ) -> str:
        found = [name for name, port in ports.items() if port.type == wanted]
        if len(found) != 1:
            several = f"{', '.join(found)} are all of type {wanted}; leave one of them"
            none = f"none is of type {wanted}; add one"
            self._problems.append(f"{self._where}.{kind}: {several if found else none}")
        return found[0] if found else ""

    def outputs_are(self, *types: str) -> None:
        """Note every output that is of none of these message types."""
        for name, port in self._config.outputs.items():
            if port.type not in types:
                self._problems.append(
                    f"{self._where}.outputs.{name}: nothing of type {port.type} is published; "
                    f"there is {', '.join(types)}"
                )

    def note_unknown(self, also_known: Iterable[str] = ()) -> None:
        """Note every parameter that nobody has read.

        also_known: parameters that went unread only because reading was cut short.
        """
        known = [*self._read, *(name for name in also_known if name not in self._read)]
        for name in self._config.params:
            if name not in known:
                self.note(str(name), f"is unknown; {nearest(str(name), known)}")

    def check(self) -> None:
        """Raise one WiringError with all that was noted and every parameter nobody has read."""
        self.note_unknown()
        if self._problems:
            self.refuse()

    def refuse(self) -> NoReturn:
        """Raise one WiringError with all that was noted."""
        raise WiringError("\n".join(self._problems))


def _as_float(value: Any) -> float:
    """Return a number as a float; NaN where it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def nearest(name: object, known: Iterable[str]) -> str:
    """Return the end of a sentence that names what `name` may have meant.

    name: as it stands in the scenario; in YAML a key may also be a number.
    """
    names = list(known)
    close = difflib.get_close_matches(str(name), names, n=3)
    if close:
        return f"did you mean {' or '.join(repr(item) for item in close)}?"
    return f"there is {', '.join(names) or 'none'}"
