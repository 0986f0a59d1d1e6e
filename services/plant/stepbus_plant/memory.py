"""What objects of the plant remember from one step to the next, for checkpoints."""

from collections.abc import Iterator
from typing import Any, ClassVar, get_type_hints

import msgspec


class Remembers:
    """An object whose next step depends on the world, on some attributes, and on its parts.

    remembers: names of these attributes. Values that MessagePack has no type for, such as tuples,
    have an annotation in the class. parts: names of attributes that are such objects themselves, or
    maps or lists of them.
    """

    remembers: ClassVar[tuple[str, ...]] = ()
    parts: ClassVar[tuple[str, ...]] = ()

    def save(self) -> Any:
        """Return the state, as values of MessagePack."""
        own = [getattr(self, key) for key in self.remembers]
        return own, [part.save() for part in self._parts()]

    def restore(self, saved: Any) -> None:
        """Take a state from `save`."""
        own, parts = saved
        types = get_type_hints(type(self))
        for key, value in zip(self.remembers, own, strict=True):
            setattr(self, key, msgspec.convert(value, types.get(key, Any)))
        for part, state in zip(self._parts(), parts, strict=True):
            part.restore(state)

    def _parts(self) -> "Iterator[Remembers]":
        for key in self.parts:
            value = getattr(self, key)
            if isinstance(value, Remembers):
                yield value
            else:
                yield from value.values() if isinstance(value, dict) else value
