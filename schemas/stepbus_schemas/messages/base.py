"""What every port message is made of."""

import contextlib
from collections.abc import Mapping
from types import MappingProxyType, NoneType
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin, get_type_hints

import msgspec

from stepbus_schemas.errors import MessageError, wrong_word

Point = tuple[float, float, float]
"""x, y, z [m]."""
Quaternion = tuple[float, float, float, float]
"""x, y, z, w, of length 1 [-]."""


def meta(
    text: str,
    unit: str = "",
    shape: str = "",
    *,
    ge: int | None = None,
    more: Mapping[str, Any] = MappingProxyType({}),
) -> Any:
    """Return the metadata of a field.

    shape: sizes, such as `k 3`; n: one for each name of the port's description. ge: its minimum.
    more: keywords of its JSON Schema.
    """
    extra = {"unit": unit} if unit else {}
    sizes = {"shape": shape.split()} if shape else {}
    schema = {**extra, **sizes, **more}
    return msgspec.Meta(description=text, ge=ge, extra_json_schema=schema or None)


class Message(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """Base of every port message: an immutable, typed MessagePack map.

    TYPE: name of your own type, `Name/major`; default: version 1 of the class's name. A subclass
    of a built-in type with the same name can require optional fields: an input can be read as the
    subclass, and a missing field is blamed on its source. Raises MessageError if a field that
    takes one of several words gets another one.
    """

    TYPE: ClassVar[str] = ""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        words = _words(cls)
        if words:
            # msgspec checks no type when a message is made; a wrong word would be met at its
            # readers only, and nowhere without any.
            own = getattr(cls, "__post_init__", None)

            def check(message: Message) -> None:
                for name, allowed in words:
                    if (value := getattr(message, name)) not in allowed:
                        text = wrong_word(value, [word for word in allowed if word is not None])
                        raise MessageError(f"{cls.__name__}: {name} {text}")
                if own is not None:
                    own(message)

            cls.__post_init__ = check  # type: ignore[attr-defined]


def _words(cls: type) -> list[tuple[str, tuple[Any, ...]]]:
    """Return the fields of a class that hold one of some words, with these."""
    hints: dict[str, Any] = {}
    # A name that only a type checker knows.
    with contextlib.suppress(NameError):
        hints = get_type_hints(cls)
    words = []
    for name, hint in hints.items():
        options = [hint] if get_origin(hint) is Literal else get_args(hint)
        if options and all(get_origin(o) is Literal or o is NoneType for o in options):
            none = (None,) if NoneType in options else ()
            words.append((name, tuple(w for o in options for w in get_args(o)) + none))
    return words


class Scalars(Message, frozen=True):
    """Named numbers; the port's description has their names."""

    values: Annotated[list[float], meta("one number per name", "", "n")]


class TextMessage(Message, frozen=True):
    """A text."""

    text: Annotated[str, meta("the text")]


class BytesMessage(Message, frozen=True):
    """Bytes that stepbus does not read; for large ones, use a bulk port."""

    data: Annotated[bytes, meta("the bytes")]
    format: Annotated[
        str, meta("what the bytes are, such as a media type; empty: known to both sides")
    ] = ""
