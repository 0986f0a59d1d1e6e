import base64
from typing import Any

import jsonschema
import msgpack
import pytest
from support.messages.vectors import TYPES, load_vectors

from stepbus_schemas import Decoder, MessageError, encode, json_schema

VECTORS = load_vectors()
REFUSED = [
    pytest.param(name, row, id=f"{name} {row['name']}")
    for name, groups in VECTORS.items()
    for row in groups["refused"]
]

each_type = pytest.mark.parametrize("type_name", VECTORS)


def _data(row: dict[str, Any]) -> bytes:
    return bytes.fromhex(row["hex"])


def _unpacked(row: dict[str, Any]) -> Any:
    return msgpack.unpackb(_data(row))


def _json_of(row: dict[str, Any]) -> Any:
    """Return a vector's message as JSON has it: binary as base64."""

    def plain(value: Any) -> Any:
        match value:
            case bytes():
                return base64.b64encode(value).decode()
            case dict():
                return {key: plain(item) for key, item in value.items()}
            case list():
                return [plain(item) for item in value]
            case _:
                return value

    return plain(_unpacked(row))


def _equal(one: Any, other: Any) -> bool:
    """Compare like `==`, but NaN equals NaN, -0.0 is not 0.0, and 1 is not 1.0."""
    return repr(one) == repr(other)


def test_every_type_has_vectors_of_each_kind() -> None:
    assert sorted(VECTORS) == sorted(TYPES)
    assert all(groups["exact"] and groups["accepted"] for groups in VECTORS.values())


@each_type
def test_our_codec_reproduces_the_exact_vectors(type_name: str) -> None:
    decode = Decoder(TYPES[type_name])
    rows = VECTORS[type_name]["exact"]
    assert [row["name"] for row in rows if encode(decode(_data(row))) != _data(row)] == []


@each_type
def test_msgpack_encodes_and_decodes_the_exact_vectors(type_name: str) -> None:
    for row in VECTORS[type_name]["exact"]:
        assert msgpack.packb(row["value"]) == _data(row), row["name"]
        assert _equal(_unpacked(row), row["value"]), row["name"]


@each_type
def test_accepted_vectors_mean_the_value_beside_them(type_name: str) -> None:
    decode = Decoder(TYPES[type_name])
    fields = json_schema(type_name)["properties"]
    defaults = {name: field["default"] for name, field in fields.items() if "default" in field}
    rows = VECTORS[type_name]["accepted"]
    values = {row["name"]: msgpack.unpackb(encode(decode(_data(row)))) for row in rows}
    wrong = [
        row["name"]
        for row in rows
        if not _equal(defaults | values[row["name"]], defaults | row["value"])
    ]
    assert wrong == []


@each_type
@pytest.mark.parametrize("group", ["exact", "accepted"])
def test_what_is_taken_validates_against_the_json_schema(type_name: str, group: str) -> None:
    validator = jsonschema.Draft202012Validator(json_schema(type_name))
    values = {row["name"]: _json_of(row) for row in VECTORS[type_name][group]}
    assert [name for name, value in values.items() if not validator.is_valid(value)] == []


@pytest.mark.parametrize(("type_name", "row"), REFUSED)
def test_what_is_wrong_is_refused_with_its_path(type_name: str, row: dict[str, Any]) -> None:
    with pytest.raises(MessageError) as caught:
        Decoder(TYPES[type_name])(_data(row))
    assert str(caught.value).startswith(f"not a {type_name}: ")
    assert row["error"] in str(caught.value.__cause__)


@each_type
def test_what_is_refused_breaks_the_json_schema_too(type_name: str) -> None:
    validator = jsonschema.Draft202012Validator(json_schema(type_name))
    rows = [row for row in VECTORS[type_name]["refused"] if row["path"] != "$"]
    rows = [row for row in rows if not row["name"].endswith(("no UTF-8", "string for binary"))]
    # Binary is no string, but where it stands for binary; in JSON, both are strings.
    has_binary = "contentEncoding" in str(json_schema(type_name))
    read = _json_of if has_binary else _unpacked
    rows = [row for row in rows if not (has_binary and row["name"].endswith("binary for a string"))]
    accepted = [row["name"] for row in rows if validator.is_valid(read(row))]
    assert accepted == []
