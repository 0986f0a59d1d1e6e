"""What every port message is made of."""

from typing import Any, ClassVar

import msgspec

Point = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


def meta(text: str, unit: str = "", shape: str = "", *, ge: int | None = None) -> Any:
    """Return the metadata of a field.

    shape: sizes, such as `k 3`; n: one for each name of the port's description.
    """
    extra = {"unit": unit} if unit else {}
    sizes = {"shape": shape.split()} if shape else {}
    return msgspec.Meta(description=text, ge=ge, extra_json_schema=(extra | sizes) or None)


class Message(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """Base of every port message: an immutable, typed MessagePack map.

    TYPE: name of a type of your own, `Name/major`; default: version 1 of the class's name.
    """

    TYPE: ClassVar[str] = ""
