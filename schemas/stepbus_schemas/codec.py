"""Typed values to MessagePack bytes and back, with errors that say where."""

from collections.abc import Callable
from typing import Generic, TypeVar

import msgspec

from .errors import MessageError
from .messages import Message
from .protocol import ENVELOPE_TYPES, Envelope
from .types import SHIPPED, Types, name_of
from .types.decode_errors import explained

T = TypeVar("T", bound=Message | Envelope)

_ENVELOPE_NAMES: dict[type[msgspec.Struct], str] = {
    cls: name for name, cls in ENVELOPE_TYPES.items()
}

encode: Callable[[Message | Envelope], bytes] = msgspec.msgpack.Encoder().encode
"""Return the MessagePack map of a message."""


def type_name(cls: type[msgspec.Struct]) -> str:
    """Return the versioned name of a message class, e.g. `JointState/1`.

    A class of your own has it as `TYPE`; without, it is version 1 of its name.
    """
    return _ENVELOPE_NAMES.get(cls) or name_of(cls)


def message_class(name: str, types: Types = SHIPPED) -> type[Message]:
    """Return the class of a port message type such as `JointState/1`.

    types: with those of one's own. Raises WiringError when there is no such type, or no such
    version of it.
    """
    return types[name]


def encoding_of(name: str) -> str:
    """Return the Zenoh encoding of a message type, e.g. `application/msgpack;stepbus.Log/1`."""
    return f"application/msgpack;stepbus.{name}"


UNDECODABLE = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What `Decoder.plain` raises for a malformed message."""


class Decoder(Generic[T]):
    """Decodes one message type.

    name: of the type in errors; default: its own.

    Raises MessageError naming the type and the path of the field that is missing or mistyped.

    plain: the same for loops in which one more call counts: it raises UNDECODABLE, of which
    `error` makes the MessageError.
    """

    def __init__(self, cls: type[T], name: str = "") -> None:
        self._name = name or type_name(cls)
        self._cls = cls
        self.plain: Callable[[bytes | msgspec.Raw], T] = msgspec.msgpack.Decoder(cls).decode

    def __call__(self, data: bytes | msgspec.Raw) -> T:
        """Return the message in `data`."""
        try:
            return self.plain(data)
        except UNDECODABLE as exc:
            raise self.error(exc) from exc

    def error(self, exc: Exception) -> MessageError:
        """Return what `plain` has raised as a sentence."""
        return MessageError(f"not a {self._name}: {explained(exc, self._cls)}")
