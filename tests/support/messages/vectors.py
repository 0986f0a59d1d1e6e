"""What the tests of the contract share: the checked-in vectors, and values of every type."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import msgspec
from hypothesis import strategies as st
from scripts.codec_vectors import from_notation
from support.paths import CHECKOUT

from stepbus_schemas import ENVELOPE_TYPES, MESSAGE_TYPES, Envelope, Message

TYPES: dict[str, type[Message] | type[Envelope]] = {**MESSAGE_TYPES, **ENVELOPE_TYPES}


def load_vectors() -> dict[str, dict[str, list[dict[str, Any]]]]:
    text = (CHECKOUT / "schemas/vectors.json").read_text(encoding="utf-8")
    return json.loads(text, object_hook=from_notation)["types"]


@cache
def messages(type_name: str) -> st.SearchStrategy[Message | Envelope]:
    return _values(msgspec.inspect.type_info(TYPES[type_name]))


def _values(info: msgspec.inspect.Type) -> st.SearchStrategy[Any]:
    match info:
        case msgspec.inspect.StructType(cls=cls, fields=fields):
            return st.builds(cls, **{field.name: _values(field.type) for field in fields})
        case msgspec.inspect.ListType(item_type=item):
            return st.lists(_values(item), max_size=4)
        case msgspec.inspect.DictType(value_type=value):
            return st.dictionaries(st.text(), _values(value), max_size=2)
        case msgspec.inspect.TupleType(item_types=items):
            return st.tuples(*map(_values, items))
        case msgspec.inspect.UnionType(types=types):
            return st.one_of(*map(_values, types))
        case msgspec.inspect.LiteralType(values=values):
            return st.sampled_from(values)
        case msgspec.inspect.Metadata(type=inner):
            return _values(inner)
        case _:
            return _scalars(info)


def _scalars(info: msgspec.inspect.Type) -> st.SearchStrategy[Any]:
    match info:
        case msgspec.inspect.IntType(ge=least):
            return st.integers(-(2**63) if least is None else least, 2**64 - 1)
        case msgspec.inspect.FloatType():
            return st.floats()
        case msgspec.inspect.StrType():
            return st.text()
        case msgspec.inspect.BytesType():
            return st.binary(max_size=9)
        case msgspec.inspect.BoolType():
            return st.booleans()
        case msgspec.inspect.NoneType():
            return st.none()
        case msgspec.inspect.RawType():
            return st.binary(max_size=9).map(lambda data: msgspec.Raw(msgspec.msgpack.encode(data)))
        case msgspec.inspect.AnyType():
            return st.one_of(st.none(), st.booleans(), st.floats(), st.text(), st.just([1, {}]))
        case _:
            raise AssertionError(f"no values for {info}")
