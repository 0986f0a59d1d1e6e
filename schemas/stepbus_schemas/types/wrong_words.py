"""A sentence of msgspec about a wrong word, completed by the words that may stand there."""

import difflib
import re
from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect

_WRONG = re.compile(r"Invalid enum value (?P<value>.*?)(?: - at `(?:key in )?\$(?P<path>.*)`)?")
_STEP = re.compile(r"\.([^.\[]+)|\[[^\]]*\]")


def explained(exc: Exception, cls: Any) -> str:
    """Return what an exception of msgspec says; of a wrong word, with the right ones.

    cls: the type that was decoded.
    """
    text = str(exc)
    found = _WRONG.fullmatch(text) if isinstance(exc, msgspec.ValidationError) else None
    words = _words_at(cls, found["path"] or "") if found else []
    if not found or not words:
        return text
    near = difflib.get_close_matches(found["value"].strip("'"), words, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{text}; it is one of {', '.join(words)}{hint}"


def _words_at(cls: Any, path: str) -> list[str]:
    """Return the words that a type allows at a path such as `.joints[0].mode`."""
    nodes = [inspect.type_info(cls)]
    for step in _STEP.finditer(path):
        nodes = [below for node in nodes for below in _below(node, step[1])]
    words = [word for node in nodes for word in _words_of(node)]
    return list(dict.fromkeys(map(str, words)))


def _below(node: Any, name: str | None) -> Iterator[Any]:
    """Yield the types one step further in; name: of a field, None for an entry of a list or map."""
    match node:
        case inspect.Metadata(type=plain):
            yield from _below(plain, name)
        case inspect.UnionType(types=options):
            for option in options:
                yield from _below(option, name)
        case inspect.StructType(fields=fields):
            yield from (field.type for field in fields if field.encode_name == name)
        case inspect.ListType(item_type=item) | inspect.VarTupleType(item_type=item):
            yield item
        case inspect.TupleType(item_types=items):
            yield from items
        case inspect.DictType(value_type=value):
            yield value


def _words_of(node: Any) -> Iterator[Any]:
    match node:
        case inspect.Metadata(type=plain):
            yield from _words_of(plain)
        case inspect.UnionType(types=options):
            for option in options:
                yield from _words_of(option)
        case inspect.LiteralType(values=values):
            yield from values
