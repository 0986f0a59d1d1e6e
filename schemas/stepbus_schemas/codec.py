"""Messages to bytes and back, and what is wrong with bytes."""

import ast
import re
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Annotated, Any, Generic, TypeVar, cast, get_args, get_origin

import msgspec

from .errors import MessageError, wrong_word
from .messages import MESSAGE_TYPES, Message
from .protocol import Envelope

_T = TypeVar("_T", bound=Message | Envelope)

_NAMES: dict[type[msgspec.Struct], str] = {cls: name for name, cls in MESSAGE_TYPES.items()}


def type_name(cls: type[msgspec.Struct]) -> str:
    """Return the versioned name of a message class, e.g. `JointState/1`.

    A class of your own has it as `TYPE`; without, it is version 1 of its name, as of an envelope.
    """
    return _NAMES.get(cls) or getattr(cls, "TYPE", "") or f"{cls.__name__}/1"


def _plain(value: Any) -> Any:
    """Return a number or an array of NumPy, which is not imported here, as Python has it."""
    if type(value).__module__ == "numpy":
        return value.tolist()
    name = f"{type(value).__module__}.{type(value).__qualname__}".removeprefix("builtins.")
    raise TypeError(f"Encoding objects of type {name} is unsupported")


encode: Callable[[Message | Envelope], bytes] = msgspec.msgpack.Encoder(enc_hook=_plain).encode
"""Return the MessagePack map of a message; numbers and arrays of NumPy are numbers and lists."""


def encoding_of(name: str) -> str:
    """Return the Zenoh encoding of a message type, e.g. `application/msgpack;stepbus.Log/1`."""
    return f"application/msgpack;stepbus.{name}"


UNDECODABLE = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What `Decoder.plain` raises for a malformed message."""


class Decoder(Generic[_T]):
    """Decodes one message type.

    name: of the type in errors; default: its own.

    Raises MessageError naming the type and the path of the field that is missing or mistyped.

    plain: the same for loops in which one more call counts: it raises UNDECODABLE, of which
    `error` makes the MessageError.
    """

    def __init__(self, cls: type[_T], name: str = "") -> None:
        self._name = name or type_name(cls)
        self._cls = cls
        self.plain: Callable[[bytes | memoryview | msgspec.Raw], _T] = msgspec.msgpack.Decoder(
            cls
        ).decode

    def __call__(self, data: bytes | msgspec.Raw) -> _T:
        """Return the message in `data`."""
        try:
            return self.plain(data)
        except UNDECODABLE as exc:
            raise self.error(exc) from exc

    @cached_property
    def makes_views(self) -> bool:
        """Return whether a message holds views of the bytes that it was decoded from."""
        return any("memoryview" in repr(field.type) for field in msgspec.structs.fields(self._cls))

    def error(self, exc: Exception) -> MessageError:
        """Return the MessageError of an exception that `plain` has raised."""
        return MessageError(f"not a {self._name}: {explained(exc, self._cls)}")


def viewing(cls: type[_T]) -> type[_T]:
    """Return a class that decodes the same, but whose bytes are views of what is decoded.

    To check a large message, and to keep none of it, without a copy.
    """
    names = [field.name for field in msgspec.structs.fields(cls) if _is_bytes(field)]
    views: Any = msgspec.defstruct(
        cls.__name__, [(name, memoryview) for name in names], bases=(cls,), kw_only=True
    )
    return cast("type[_T]", views)


def _is_bytes(field: msgspec.structs.FieldInfo) -> bool:
    is_bare = get_origin(field.type) is not Annotated
    return field.required and bytes is (field.type if is_bare else get_args(field.type)[0])


def explained(exc: Exception, cls: Any = Any) -> str:
    """Return the message of an exception of msgspec, or of the file that it was to read.

    Such as "values[0]: Expected `float`, got `str`": the path comes first.
    cls: the type that was decoded; with it, the message about a wrong word lists the right ones.
    """
    if isinstance(exc, OSError):
        return exc.strerror or str(exc)
    text, _, place = str(exc).partition(" - at ")
    path = place.replace("`", "").removeprefix("$").removeprefix(".")
    word = re.fullmatch(r"Invalid enum value (.*)", text, re.DOTALL)
    if word and (words := _words_at(cls, path)):
        text = wrong_word(ast.literal_eval(word[1]), words)
    return f"{path}: {text}" if path else text


def _words_at(cls: Any, path: str) -> list[str]:
    """Return the words that a type allows for the field of a path such as `joints[0].mode`."""
    (root,), parts = msgspec.json.schema_components([cls])
    name = next(reversed(re.findall(r"[a-z]\w*", path)), "")
    nodes = [part["properties"][name] for part in parts.values() if name in part["properties"]]
    return list(dict.fromkeys(str(word) for node in nodes or [root] for word in _words(node)))


def _words(schema: Any) -> Iterator[str]:
    """Yield the words of a JSON Schema: its own, or those of its entries and alternatives."""
    yield from schema.get("enum", ())
    for inner in (*schema.get("anyOf", ()), *schema.get("prefixItems", ())):
        yield from _words(inner)
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield from _words(schema[key])
