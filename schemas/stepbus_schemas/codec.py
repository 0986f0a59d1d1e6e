"""Collision shapes, as the detail `shape` of a description of Poses/1 writes them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import msgspec

from stepbus_schemas.errors import MessageError
from stepbus_schemas.messages import Message, Point, Quaternion
from stepbus_schemas.protocol import ENVELOPE_TYPES, Envelope
from stepbus_schemas.types import SHIPPED, Types, name_of
from stepbus_schemas.types.decode_errors import explained

_SIZES = {"box": 3, "capsule": 2, "cylinder": 2, "sphere": 1}
_ORIGIN = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


@dataclass(frozen=True)
class Shape:
    """One collision shape in the frame of its link.

    type: `box`, `capsule`, `cylinder`, `sphere`, or the word for one without sizes, such as `mesh`.
    sizes: X Y Z of a box, RADIUS LENGTH of a capsule or cylinder, RADIUS of a sphere [m].
    position: x, y, z [m]. orientation: quaternion x, y, z, w.
    """

    type: str
    sizes: tuple[float, ...]
    position: Point
    orientation: Quaternion


def parse_shapes(text: str) -> list[Shape]:
    """Return the shapes of a text such as `sphere 0.1 @ 0 0 0 0 0 0 1; mesh`.

    A shape without a pose is at the origin of its link. Raises ValueError for sizes that are
    missing or not positive, and for a pose that is not finite.
    """
    return [_parse(part.strip()) for part in text.split(";") if part.strip()]


def _parse(text: str) -> Shape:
    form, _, pose = text.partition("@")
    name, *sizes = form.split() or [""]
    numbers, at = _numbers(sizes), _numbers(pose.split()) or _ORIGIN
    is_sized = name not in _SIZES or (len(numbers) == _SIZES[name] and min(numbers) > 0)
    if not is_sized or len(at) != len(_ORIGIN) or not any(at[3:]):
        raise ValueError(f"shape {text!r} cannot be read")
    x, y, z, qx, qy, qz, qw = at
    return Shape(name, tuple(numbers), (x, y, z), (qx, qy, qz, qw))


def _numbers(words: Sequence[str]) -> list[float]:
    """Return words as numbers; a NaN alone if one of them is not finite."""
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return [math.nan]
    return numbers if all(map(math.isfinite, numbers)) else [math.nan]


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
