from contextlib import suppress
from typing import Any, Literal

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.messages.vectors import TYPES, messages
from support.properties import examples

from stepbus_schemas import (
    MESSAGE_TYPES,
    SHIPPED,
    Decoder,
    Image,
    JointCommand,
    JointState,
    MessageError,
    Trigger,
    Types,
    WiringError,
    encode,
    explained,
    viewing,
)


class Inner(msgspec.Struct):
    mode: Literal["a", "b"]


class Nested(msgspec.Struct):
    listed: list[Literal["a", "b"]] | None = None
    mapped: dict[str, Literal["c", "d"]] = {}
    pair: tuple[Literal["e", "f"], int] | None = None
    inner: list[Inner] = []


# Derandomised: a test that fails must fail for everybody; no deadline: a time decides no test.
repeatable = settings(max_examples=examples(25))


@pytest.mark.parametrize("name", TYPES)
@repeatable
@given(data=st.data())
def test_every_message_comes_back_byte_for_byte(name: str, data: st.DataObject) -> None:
    wire = encode(data.draw(messages(name)))
    assert encode(Decoder(TYPES[name])(wire)) == wire


@pytest.mark.parametrize("name", TYPES)
@repeatable
@given(data=st.binary(max_size=60))
def test_noise_raises_nothing_but_a_message_error(name: str, data: bytes) -> None:
    with suppress(MessageError):
        assert isinstance(Decoder(TYPES[name])(data), TYPES[name])


def test_nesting_without_end_is_refused() -> None:
    bottomless = b"\x82\xaastep_limit\x01\xa5token" + b"\x91" * 100_000
    with pytest.raises(MessageError, match="not a Trigger/1"):
        Decoder(Trigger)(bottomless)


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (
            {"mode": "torqe", "values": [1.0]},
            (
                "mode: must be brake, position, teleport, torque or velocity, not 'torqe'; "
                "did you mean 'torque'?"
            ),
        ),
        ({"mode": "fly", "values": [1.0]}, "position, teleport, torque or velocity, not 'fly'"),
        ({"mode": 7, "values": [1.0]}, "mode: Expected `str`, got `int`"),
    ],
)
def test_a_wrong_word_lists_the_right_ones(message: object, sentence: str) -> None:
    with pytest.raises(MessageError) as caught:
        Decoder(JointCommand)(msgspec.msgpack.encode(message))
    assert str(caught.value).endswith(sentence)


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        ({"listed": ["a", "z"]}, "listed[1]: must be a or b, not 'z'"),
        ({"mapped": {"key": "z"}}, "mapped[...]: must be c or d, not 'z'"),
        ({"pair": ["z", 1]}, "pair[0]: must be e or f, not 'z'"),
        ({"inner": [{"mode": "z"}]}, "inner[0].mode: must be a or b, not 'z'"),
    ],
)
def test_a_wrong_word_is_explained_wherever_it_stands(value: object, sentence: str) -> None:
    with pytest.raises(msgspec.ValidationError) as caught:
        msgspec.convert(value, Nested)
    assert explained(caught.value, Nested) == sentence


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("JointState/9", "did you mean 'JointState/1'"),
        ("Zzz", "known: BaseCommand/1, BaseState/1"),
        ("IMU/1", "did you mean 'Imu/1'"),
        ("Log/1", "unknown message type 'Log/1'"),
    ],
    ids=["version", "name", "letters", "envelope"],
)
def test_an_unknown_type_is_told_the_nearest_or_all(name: str, told: str) -> None:
    with pytest.raises(WiringError, match=told):
        SHIPPED[name]


@pytest.mark.parametrize(
    ("position", "expected"),
    [
        ([np.float64(0.25)], [0.25]),
        (np.array([1.0, -2.0]), [1.0, -2.0]),
        ([np.float32(0.5), np.int64(3)], [0.5, 3.0]),
    ],
)
def test_numbers_of_numpy_are_numbers(position: Any, expected: list[float]) -> None:
    data = encode(JointState(position=position))
    assert Decoder(JointState)(data).position == expected


def test_a_view_takes_and_refuses_what_the_type_does_and_copies_no_bytes():
    types = {cls: viewing(cls) for cls in MESSAGE_TYPES.values()}
    own = Types({"Blob/1": {"raw": {"type": "bytes"}, "n": {"type": "int", "min": 1}}})["Blob/1"]
    for cls, view in {**types, own: viewing(own)}.items():
        decoders = [msgspec.msgpack.Decoder(one) for one in (cls, view)]
        fields = [field.name for field in msgspec.structs.fields(cls)]
        for value in (b"bytes", "text", 0, 1, -1, 0.5, None, [], [1.0, 2.0], {}, "rgb8"):
            for name in (*fields, ""):
                row = {field: b"xyz" if field in {"data", "raw"} else 1 for field in fields}
                row |= {name: value} if name else {}
                assert outcome(decoders[0], row) == outcome(decoders[1], row)
    image = Image(width=1, height=1, encoding="rgb8", data=b"abc", focal=(1, 1), centre=(0, 0))
    content = encode(image)
    seen = msgspec.msgpack.Decoder(types[Image]).decode(content)
    assert (type(seen.data), seen.data.obj) == (memoryview, content)
    assert bytes(seen.data) == image.data


def outcome(decoder, row):
    try:
        decoder.decode(msgspec.msgpack.encode(row))
    except msgspec.DecodeError as exc:
        return str(exc)
    return None
