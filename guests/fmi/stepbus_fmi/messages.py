"""Values of FMUs that are no real numbers; those are `Scalars/1`."""

from typing import Annotated

from stepbus_schemas import Message, meta


class Integers(Message, frozen=True):
    """Named integers, and enumerations by their numbers; the description has the names."""

    values: Annotated[list[int], meta("one number per name", "", "n")]


class Booleans(Message, frozen=True):
    """Named truth values; the description has the names."""

    values: Annotated[list[bool], meta("one value per name", "", "n")]


class Texts(Message, frozen=True):
    """Named texts; the description has the names."""

    values: Annotated[list[str], meta("one text per name", "", "n")]


class Binaries(Message, frozen=True):
    """Named binary values; the description has the names."""

    values: Annotated[list[bytes], meta("one value per name", "", "n")]
