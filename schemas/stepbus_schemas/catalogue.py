"""The message types that a run knows: those that ship, and its own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from typing import Any

from .codec import type_name
from .declaration import Declaration, class_declaration, declare, differences, normal
from .errors import WiringError, suggest
from .messages import MESSAGE_TYPES, Message


class Types:
    """Message types by name: `types["Thruster/1"]` is a class; built-in types are always included.

    declarations: of the user-defined types, by name. classes: for some of them, in place of the
    classes made from their declarations. Immutable. Two are equal if their declarations are.
    """

    def __init__(
        self,
        declarations: Mapping[str, Mapping[str, Any]] | None = None,
        classes: Mapping[str, type[Message]] | None = None,
    ) -> None:
        self.declarations: Mapping[str, Declaration] = {
            name: normal(row) for name, row in (declarations or {}).items()
        }
        declared = {name: declare(name, row) for name, row in self.declarations.items()}
        self._own = {**declared, **(classes or {})}

    @classmethod
    def of(cls, classes: Iterable[type[Message]]) -> Types:
        """Return a catalogue with the types of message classes, and these classes.

        Raises WiringError for a class that a declaration cannot express.
        """
        own = {type_name(item): item for item in classes if not _ships(item)}
        return cls({name: class_declaration(item) for name, item in own.items()}, own)

    def __getitem__(self, name: str) -> type[Message]:
        """Return the class of a message type such as `JointState/1`.

        Raises WiringError when there is no such type, or no such version of it.
        """
        cls = MESSAGE_TYPES.get(name) or self._own.get(name)
        if cls is not None:
            return cls
        known = suggest(name, (*MESSAGE_TYPES, *self._own))
        raise WiringError(f"unknown message type {name!r}{known}")

    def __contains__(self, name: object) -> bool:
        """Return whether there is such a type."""
        return name in MESSAGE_TYPES or name in self._own

    def __or__(self, other: Types) -> Types:
        """Return both; classes and declarations of the other one come first."""
        return Types({**self.declarations, **other.declarations}, {**self._own, **other._own})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Types) and self.declarations == other.declarations

    def __hash__(self) -> int:
        return hash(frozenset(self.declarations))

    def __repr__(self) -> str:
        return f"Types({', '.join(self.declarations)})"

    def only(self, names: Iterable[str]) -> Types:
        """Return a catalogue with only some types, and the built-in ones."""
        kept = [name for name in dict.fromkeys(names) if name in self._own]
        return Types(
            {name: self.declarations[name] for name in kept},
            {name: self._own[name] for name in kept},
        )

    def misfits(self, other: Types, mine: str, others: str) -> list[str]:
        """Return a message for each type whose two declarations differ.

        mine, others: names of the two sides, such as "the program".
        """
        return [
            f"{name} differs: {field} is {one} in {mine}, {two} in {others}; use the same "
            "declaration, or raise the version of the changed type"
            for name, row in self.declarations.items()
            if name in other.declarations
            for field, one, two in islice(differences(row, other.declarations[name]), 1)
        ]


def _ships(cls: type[Message]) -> bool:
    """Return whether a class is one that ships, or one of its name that requires more fields."""
    return issubclass(cls, MESSAGE_TYPES.get(type_name(cls), ()))


SHIPPED = Types()
"""The types that ship, and no others."""
