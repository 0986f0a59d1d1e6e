"""Plain values, where no other type fits."""

from typing import Annotated

from .base import Message, meta


class Scalars(Message, frozen=True):
    """Named numbers; the port's description has their names."""

    values: Annotated[list[float], meta("one number for each name", "", "n")]


class TextMessage(Message, frozen=True):
    """A text, of type `Text/1`."""

    text: Annotated[str, meta("the text")]


class BytesMessage(Message, frozen=True):
    """Bytes that stepbus does not read, of type `Bytes/1`; large ones belong on a bulk port."""

    data: Annotated[bytes, meta("the bytes")]
    format: Annotated[str, meta("what they are, such as a media type; empty: agreed upon")] = ""
