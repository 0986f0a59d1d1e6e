"""What each protocol number stands for: every byte vector that was ever published under it.

`schemas/published/<number>.json` has, for each type, the bytes of `exact` vectors, of `accepted`
ones with the bytes that our encoder makes of them, and of `refused` ones. New vectors are added to
the file of the present number; none is changed or removed. So a field may be added under a number,
with a default, and nothing else may change (P14.2).
"""

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from stepbus_schemas.codec import Decoder, encode, type_name
from stepbus_schemas.errors import MessageError
from stepbus_schemas.messages import MESSAGE_TYPES
from stepbus_schemas.protocol import ENVELOPE_TYPES
from stepbus_schemas.schema import json_schema
from stepbus_schemas.vectors import from_notation

Published = dict[str, dict[str, dict[str, str]]]
"""Type → group of vectors → hex of a vector → hex of what an accepted one means."""

_GROUPS = ("exact", "accepted", "refused")

_pack = msgspec.msgpack.Encoder().encode


def published(before: Published, vectors: Mapping[str, Any]) -> Published:
    """Return what is published once `vectors`, the content of `vectors.json`, are too."""
    now = {name: _of_type(groups) for name, groups in vectors["types"].items()}
    return {
        name: {group: _added(name, group, before, now) for group in _GROUPS}
        for name in sorted({*before, *now})
    }


def _added(name: str, group: str, before: Published, now: Published) -> dict[str, str]:
    old = before.get(name, {}).get(group, {})
    return old | now.get(name, {}).get(group, {}) | old


def broken(vectors: Published) -> dict[str, list[str]]:
    """Return, for each type, the published vectors that our codec reads differently today."""
    failures = {name: list(_broken(name, groups)) for name, groups in vectors.items()}
    return {name: rows for name, rows in failures.items() if rows}


def _of_type(groups: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    return {
        "exact": {row["hex"]: "" for row in groups["exact"]},
        "accepted": {row["hex"]: _meaning(row["value"]) for row in groups["accepted"]},
        "refused": {row["hex"]: "" for row in groups["refused"]},
    }


def _meaning(value: Any) -> str:
    return _pack(_plain(value)).hex()


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return from_notation({key: _plain(item) for key, item in value.items()})
    return [_plain(item) for item in value] if isinstance(value, list) else value


def _broken(name: str, groups: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    cls = {**MESSAGE_TYPES, **ENVELOPE_TYPES}.get(name)
    if cls is None:
        yield from groups["exact"]
        return
    read = _Reader(cls)
    yield from (data for data in groups["exact"] if read.encoded(data).hex() != data)
    yield from (data for data, meaning in groups["accepted"].items() if not read(data, meaning))
    yield from (data for data in groups["refused"] if read.encoded(data))


class _Reader:
    """Reads vectors of one type; two mean the same where they differ by a default at most."""

    def __init__(self, cls: Any) -> None:
        self._decode = Decoder(cls)
        fields = json_schema(type_name(cls))["properties"].items()
        self._defaults = {name: field["default"] for name, field in fields if "default" in field}

    def encoded(self, data: str) -> bytes:
        """Return what our encoder makes of a vector; nothing where it is refused."""
        try:
            return encode(self._decode(bytes.fromhex(data)))
        except MessageError:
            return b""

    def __call__(self, data: str, meaning: str) -> bool:
        # As text: NaN equals NaN there, and -0.0 is not 0.0.
        one, other = (self._value(text) for text in (data, meaning))
        return one is not None and repr(one) == repr(other)

    def _value(self, data: str) -> dict[str, Any] | None:
        value = self.encoded(data)
        return self._defaults | msgspec.msgpack.decode(value) if value else None
