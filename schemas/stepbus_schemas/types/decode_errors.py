"""What msgspec says of a value that it cannot decode or encode, as a sentence for people."""

import re
from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect

from stepbus_schemas.words import wrong_word

_FORM = re.compile(r"(?P<text>.*?)(?: - at (?P<key>`key` in )?`\$(?P<path>.*)`)?", re.DOTALL)
_STEP = re.compile(r"\.([^.\[]+)|\[[^\]]*\]")
_NOUNS = {
    "array": "a list",
    "object": "a map",
    "str": "text",
    "int": "an integer",
    "float": "a number",
    "bool": "true or false",
    "bytes": "bytes",
    "null": "null",
    "None": "null",
    "ext": "an extension of MessagePack",
}
_RULES = (
    (r"Object missing required field `(.*)`", r"the field '\1' is missing"),
    (r"Object contains unknown field `(.*)`", r"unknown field '\1'"),
    (r"Expected `array` of length (\d+), got (\d+)", r"must be a list of \1, not of \2"),
    (r"Expected `array` of length >= (\d+)", r"must be a list of at least \1"),
    (r"Expected `array` of length <= (\d+)", r"must be a list of at most \1"),
    (r"Expected `str` of length >= 1", r"must not be empty"),
    (r"Expected `(?:int|float)` >= (.*)", r"must be at least \1"),
    (r"Expected `(?:int|float)` <= (.*)", r"must be at most \1"),
    (r"Expected `(?:int|float)` > (.*)", r"must be above \1"),
    (r"Expected `(?:int|float)` < (.*)", r"must be below \1"),
    (r"Input data was truncated", r"ends in the middle of a value"),
    (r"(\w+)(?: data)? is malformed: (.*) \(byte (\d+)\)", r"is no \1 from byte \3 on: \2"),
)


_OTHERS = (
    (UnicodeDecodeError, "has text that is not UTF-8"),
    (UnicodeEncodeError, "has text that is not valid Unicode"),
    (RecursionError, "is nested too deeply"),
    (OverflowError, "has an integer that does not fit into 64 bits"),
)


def explained(exc: Exception, cls: Any = Any) -> str:
    """Return what an exception of msgspec means, or of the file that it was to read.

    cls: the type that was decoded; with it, a wrong word is told with the right ones.
    """
    if isinstance(exc, OSError):
        return exc.strerror or str(exc)
    for kind, sentence in _OTHERS:
        if isinstance(exc, kind):
            return sentence
    if not isinstance(exc, msgspec.DecodeError):
        return _unencodable(str(exc))
    match = _FORM.fullmatch(str(exc))
    text, path = str(exc), ""
    if match is not None:
        text, path = match["text"], (match["path"] or "").removeprefix(".")
    meaning = _meaning(text, cls, match["path"] or "" if match else "")
    where = f"a key of {path or 'it'}" if match and match["key"] else path
    joint = ": " if not meaning.startswith("must ") else " "
    return f"{where}{joint}{meaning}" if where else meaning


def _unencodable(text: str) -> str:
    match = re.fullmatch(r"Encoding objects of type (.*) is unsupported", text)
    if not match:
        return text
    hint = "; write `.tolist()`" if match[1].startswith("numpy.") else ""
    return f"has a value of type {match[1]}, which no message can carry{hint}"


def _meaning(text: str, cls: Any, path: str) -> str:
    for pattern, sentence in _RULES:
        match = re.fullmatch(pattern, text)
        if match:
            return match.expand(sentence)
    word = re.fullmatch(r"Invalid enum value (.*)", text, re.DOTALL)
    words = _words_at(cls, path) if word else []
    if word and words:
        return wrong_word(_plain(word[1]), words)
    mistyped = re.fullmatch(r"Expected `(.*)`, got `(.*)`", text)
    if mistyped:
        wanted = " or ".join(_noun(name) for name in mistyped[1].split(" | "))
        return f"must be {wanted}, not {_noun(mistyped[2])}"
    return text


def _plain(shown: str) -> object:
    """Return the value that msgspec shows: a text in quotes, or an integer."""
    return int(shown) if re.fullmatch(r"-?\d+", shown) else shown.removeprefix("'")[:-1]


def _noun(name: str) -> str:
    return _NOUNS.get(name, name)


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
