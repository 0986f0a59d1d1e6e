"""The fields of a map: which keys it may have, which it must have, and what they may be."""

from collections.abc import Callable, Mapping
from typing import Any

from msgspec import inspect

from stepbus_participant.hints.suggestions import suggest

from .nodes import (
    conditions,
    default,
    empty,
    is_ignored,
    is_own,
    is_plugin,
    listed,
    options_of,
    words_of,
)
from .problems import Keys, Problems, show
from .settings import PerName, Settings


class Fields:
    """The fields of one struct; data: without the keys that are null.

    read: returns data as what a node of a type describes. short: key of the struct that a text
    stands for, where the data is one.
    """

    def __init__(
        self,
        *,
        read: Callable[[inspect.Type, Any, Keys], Any],
        problems: Problems,
        node: inspect.StructType,
        data: Mapping[Any, Any],
        keys: Keys,
        short: str,
    ) -> None:
        self._read, self._problems = read, problems
        self._data, self._keys, self._short = data, keys, short
        self._fields = {f.encode_name: f for f in node.fields if not is_own(f)}
        settings: Any = node.cls
        self._elsewhere = settings.elsewhere
        self._own = [field.name for field in node.fields if is_own(field)]
        # Whether the data names a class of the user's own.
        self._has_plugin = any(
            isinstance(value := data.get(key), str) and ":" in value
            for key, field in self._fields.items()
            if is_plugin(field.type)
        )

    def values(self) -> dict[str, Any]:
        """Return name of a field → value; what is wrong is added to the problems."""
        found = {field.name: self._value(key, field) for key, field in self._fields.items()}
        surplus = {key: item for key, item in self._data.items() if self._is_surplus(key)}
        if not self._has_plugin:
            for key in surplus:
                text = self._unknown(key) if isinstance(key, str) else not_text(key)
                self._problems.add((*self._keys, str(key)), text)
            surplus = {}
        self._check_names(found)
        return found | dict.fromkeys(self._own, surplus)

    def _unknown(self, key: str) -> str:
        place = self._elsewhere(key)
        return f"unknown key {key!r}{f'; {place}' if place else suggest(key, self._fields)}"

    def _is_surplus(self, key: Any) -> bool:
        field = self._fields.get(key)
        return field is None or (self._has_plugin and self._applies(field) is False)

    def _value(self, key: str, field: inspect.Field) -> Any:
        instead = empty(field.type) if field.required else default(field)
        where, applies = (*self._keys, key), self._applies(field)
        if key not in self._data:
            if field.required and applies and not self._problems.has(where):
                self._problems.add(self._keys, f"the key {key!r} is missing")
            return instead
        if applies is False and not is_ignored(field):
            if not self._has_plugin:
                self._problems.add(where, self._misplaced(field))
            return instead
        before = len(self._problems)
        where = (*self._keys, *without(self._short, (key,)))
        value = self._read(field.type, self._data[key], where)
        wrong = len(self._problems) > before
        # What is right in a map is kept; a participant without outputs would be a second problem.
        replaced = wrong and not field.required and not isinstance(value, Settings | dict)
        return instead if replaced else value

    def _applies(self, field: inspect.Field) -> bool | None:
        """Return whether a field means something beside the others; None: they do not decide it."""
        wanted = conditions(field)
        if not self._has_plugin and not all(self._is_decided(key) for key in wanted):
            return None
        return all(self._setting(key) in values for key, values in wanted.items())

    def _is_decided(self, key: str) -> bool:
        """Return whether a key has a value that it may have."""
        return self._setting(key) in (*words_of(options_of(self._fields[key].type)), True, False)

    def _setting(self, key: str) -> Any:
        """Return the value of another field, as it stands or by default."""
        field = self._fields[key]
        value = self._data.get(key, None if field.required else default(field))
        return value if isinstance(value, str | bool) else None

    def _misplaced(self, field: inspect.Field) -> str:
        wanted = " and ".join(f"{k} {listed(v)}" for k, v in conditions(field).items())
        now = " and ".join(f"{k} is {show(self._setting(k))}" for k in conditions(field))
        return f"belongs to {wanted}; {now}"

    def _check_names(self, found: Mapping[str, Any]) -> None:
        """Add what does not fit `joints` among the numbers that are one for each of them."""
        joints = found.get("joints")
        if not joints or "joints" not in self._data:
            return
        for key, field in self._fields.items():
            value = found[field.name]
            if isinstance(value, PerName) and key in self._data:
                for where, text in value.misfits(joints):
                    self._problems.add((*self._keys, key, *where), text)


def without(short: str, where: Keys) -> Keys:
    """Return keys without the first, where a text stands for that one."""
    return where[1:] if short and where[:1] == (short,) else where


def not_text(key: object) -> str:
    """Return what is wrong with a key that is no text."""
    return f"a key must be text, not {key!r}; put it in quotes"
