"""Message types of one's own: declarations, what follows from them, and what is refused."""

import json
import math
from typing import Annotated, ClassVar, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripts.codec_vectors import from_notation

from stepbus_schemas import (
    Decoder,
    Imu,
    LaserScan,
    Message,
    MessageError,
    RawLayout,
    Types,
    WiringError,
    class_declaration,
    declaration_of,
    encode,
    json_schema,
    meta,
    raw_fields,
    type_problems,
    types_vectors,
)

THRUSTER = {
    "help": "Commands to thrusters.",
    "thrust": {"type": "float[n]", "unit": "N", "help": "of each"},
    "mode": ["off", "hold", "auto"],
    "enabled": {"type": "bool", "default": False},
    "gain": {"type": "float", "default": 0},
    "count": {"type": "int", "min": 0, "default": 3},
    "at": {"type": "float[k, 3]", "unit": "m", "optional": True},
}
TYPES = Types({"Thruster/1": THRUSTER})
Thruster = TYPES["Thruster/1"]

scalars = st.sampled_from(["float", "int", "bool", "text", "bytes"])
sizes = st.sampled_from(["", "[3]", "[n]", "[k]", "[n,3]", "[2,2]", "[k,m]"])
words = st.lists(st.sampled_from(["off", "on", "auto", "x"]), min_size=2, unique=True)
rows = st.builds(
    lambda form, optional, unit: {"type": form, "optional": optional, "unit": unit},
    st.one_of(words, st.builds(str.__add__, scalars, sizes)),
    st.booleans(),
    st.sampled_from(["", "N", "m/s²"]),
)
declarations = st.dictionaries(
    st.from_regex("[a-z][a-z0-9_]{0,8}", fullmatch=True).filter(lambda name: name != "help"),
    rows,
    min_size=1,
    max_size=15,
)


@given(declarations)
def test_a_declaration_comes_back_from_its_schema(declaration):
    types = Types({"Own/1": declaration})
    recorded = json.loads(json.dumps(json_schema("Own/1", types), sort_keys=True))
    assert Types({"Own/1": declaration_of("Own/1", recorded)}) == types


@pytest.mark.parametrize(
    ("form", "default"),
    [("float[k]", [1.0, 2.0]), ("float[n,2]", [[1.0, 2.0]]), ("int[2]", [3, 4]), ("text[k]", [])],
)
def test_the_default_of_an_array_comes_back_from_its_schema(form, default):
    types = Types({"Own/1": {"a": {"type": form, "default": default, "unit": "N"}}})
    recorded = json.loads(json.dumps(json_schema("Own/1", types)))
    assert Types({"Own/1": declaration_of("Own/1", recorded)}) == types
    assert not Types.of([types["Own/1"]]).misfits(types, "the class", "the declaration")
    assert Decoder(types["Own/1"])(encode(types["Own/1"]())) == types["Own/1"]()


def test_an_optional_integer_may_have_a_minimum():
    types = Types({"Own/1": {"a": {"type": "int", "min": 2, "optional": True}}})
    recorded = json.loads(json.dumps(json_schema("Own/1", types)))
    assert Types({"Own/1": declaration_of("Own/1", recorded)}) == types
    decode = Decoder(types["Own/1"])
    assert (decode(b"\x80").a, decode(msgspec.msgpack.encode({"a": 2})).a) == (None, 2)
    with pytest.raises(MessageError, match="a: Expected `int` >= 2"):
        decode(msgspec.msgpack.encode({"a": 1}))


def test_a_default_that_only_a_function_knows_is_refused():
    class Odd(Message, frozen=True):
        a: list[float] = msgspec.field(default_factory=lambda: [1.0])

    with pytest.raises(WiringError, match="its default comes from a function"):
        class_declaration(Odd)


@given(declarations)
def test_the_byte_vectors_of_a_type_are_read_and_written(declaration):
    types = Types({"Own/1": declaration})
    decode = Decoder(types["Own/1"])
    vectors = json.loads(types_vectors(types), object_hook=from_notation)["types"]["Own/1"]
    for row in vectors["exact"]:
        assert encode(decode(bytes.fromhex(row["hex"]))).hex() == row["hex"]


@given(declarations, st.integers(1, 3), st.integers(1, 3))
def test_what_is_numbers_alone_comes_back_from_them(declaration, names, length):
    types = Types({"Own/1": declaration})
    if not raw_fields("Own/1", types):
        return
    layout = RawLayout("Own/1", types, names=names, length=length)
    numbers = [float(index % 2) for index in range(layout.width)]
    message = layout.unflatten(numbers)
    assert Decoder(types["Own/1"])(encode(message)) == message
    assert layout.flatten(message) == numbers


def test_a_message_of_ones_own_has_values_defaults_and_bytes_of_its_own():
    message = Thruster(thrust=[1.5], mode="auto")
    assert (message.enabled, message.gain, message.count, message.at) == (False, 0.0, 3, None)
    assert msgspec.msgpack.decode(encode(message)) == {"thrust": [1.5], "mode": "auto"}
    assert isinstance(message, Message)


def test_a_type_that_ships_is_in_every_catalogue():
    assert TYPES["Imu/1"] is Imu
    with pytest.raises(WiringError, match=r"'Thruster/3'; did you mean 'Thruster/1'"):
        TYPES["Thruster/3"]


class Battery(Message, frozen=True):
    """State of a battery."""

    charge: Annotated[float, meta("share of its capacity", "-")]
    cells: Annotated[list[float], meta("voltage of each cell", "V", "n")]
    state: Literal["idle", "busy"] = "idle"
    middle: tuple[float, float] | None = None


class NextBattery(Message, frozen=True):
    """Another version."""

    TYPE: ClassVar[str] = "Battery/2"
    charge: float


def test_a_class_in_python_declares_a_type_too():
    assert class_declaration(Battery) == {
        "help": "State of a battery.",
        "charge": {"type": "float", "unit": "-", "help": "share of its capacity"},
        "cells": {"type": "float[n]", "unit": "V", "help": "voltage of each cell"},
        "state": {"type": ["busy", "idle"], "default": "idle"},
        "middle": {"type": "float[2]", "optional": True},
    }
    types = Types.of([Battery, NextBattery, Imu])
    assert list(types.declarations) == ["Battery/1", "Battery/2"]
    assert types["Battery/2"] is NextBattery


class Nested(Message, frozen=True):
    """A struct in a struct."""

    inner: Battery


def test_a_class_that_no_declaration_can_say_is_refused():
    with pytest.raises(WiringError, match="a field must be float, int"):
        class_declaration(Nested)


PROBLEMS = [
    ("thruster", {"a": "float"}, "'thruster' is not a type name; write Name/major"),
    ("Imu/1", {"a": "float"}, "Imu/1 ships with stepbus"),
    ("T/1", ["a"], "must be a map: field"),
    ("T/1", {}, "has 0 fields; it needs 1 to 15"),
    ("T/1", {"Big": "float"}, "'Big' is not a field name"),
    ("T/1", {"a": "flot"}, "must be float, int, bool"),
    ("T/1", {"a": "float[0]"}, "'0' is not a size"),
    ("T/1", {"a": "float[65]"}, "64 entries, not 65"),
    ("T/1", {"a": "float[k,2,n,2]"}, "has 4 sizes, at most 3"),
    ("T/1", {"a": {"type": ["x"], "default": b"x"}}, "does not match the type"),
    ("T/1", {"a": ["on", True]}, "a list holds the allowed words"),
    ("T/1", {"a": {"unit": "N"}}, "'type' is missing"),
    ("T/1", {"a": {"type": "float", "units": "N"}}, "unknown key 'units'"),
    ("T/1", {"a": {"type": "float", "unit": 3}}, "Expected `str`, got `int`"),
    ("T/1", {"a": {"type": "float", "min": 1}}, "on a field of type int"),
    ("T/1", {"a": {"type": "int", "min": 2**63}}, "Expected `int` <= 9223372036854775807"),
    ("Fault/1", {"a": "float"}, "Fault/1 is a protocol message"),
    (
        "T/1",
        {"a": {"type": ["off", "on"], "default": "of"}},
        "did you mean 'off'?",
    ),
    ("T/1", {"a": {"type": "int", "min": 2, "default": 1}}, "does not match the type"),
    (
        "T/1",
        {"a": {"type": "int", "optional": True, "default": 1}},
        "is not allowed: an optional field",
    ),
    ("T/1", {"a": {"type": "float[k]", "default": [math.inf]}}, "must be finite"),
    ("T/1", {"a": {"type": "bytes", "default": "x"}}, "is not allowed for bytes"),
    ("T/1", {"a": "float", "help": {"type": "text"}}, "describes the type"),
]


@pytest.mark.parametrize(("name", "declaration", "sentence"), PROBLEMS)
def test_a_mistake_in_a_declaration_has_its_sentence(name, declaration, sentence):
    found = [text for _, text in type_problems(name, declaration)]
    assert len(found) == 1
    assert sentence in found[0]


def misfits(one, other):
    return Types({"T/1": one}).misfits(Types({"T/1": other}), "one", "other")


@pytest.mark.parametrize(
    "other",
    [
        {"a": "float"},
        {"help": "Else.", "a": {"type": "float", "help": "else"}},
        {"b": {"type": "int", "optional": True}, "a": "float"},
        {"a": "float", "b": {"type": "int", "default": 0}},
    ],
)
def test_help_order_and_fields_that_may_be_left_out_make_no_difference(other):
    assert misfits({"a": "float"}, other) == misfits(other, {"a": "float"}) == []


@pytest.mark.parametrize(
    ("other", "text"),
    [
        ({"a": "int"}, "T/1 differs: a is of type float in one, of type int in other"),
        (
            {"a": {"type": "float", "unit": "N"}},
            'a is of type float in one, of type float, unit "N" in other',
        ),
        ({"a": "float", "b": "int"}, "b is absent in one, of type int in other"),
        ({"b": "float"}, "a is of type float in one, absent in other"),
        (
            {"a": {"type": "float", "default": 1}},
            "a is of type float in one, of type float, default 1 in other",
        ),
    ],
)
def test_every_other_difference_is_told(other, text):
    assert text in misfits({"a": "float"}, other)[0]


def test_lists_without_names_take_their_length_from_the_shape():
    layout = RawLayout("LaserScan/1", length=3)
    scan = LaserScan(
        angle_min=0.0, angle_increment=0.1, range_min=0.0, range_max=5.0, ranges=[1.0, 2.0, 3.0]
    )
    numbers = layout.flatten(scan)
    assert numbers[:7] == [0.0, 0.1, 0.0, 5.0, 1.0, 2.0, 3.0]
    assert layout.unflatten(numbers) == scan
    assert list(RawLayout("LaserScan/1").lacks()) == ["shape"]


@pytest.mark.parametrize(
    ("declaration", "numbers", "sentence"),
    [
        ({"a": "bool"}, [2.0], "a is 2, not 0 or 1"),
        ({"a": "int"}, [0.5], "a is 0.5, not a whole number"),
        ({"a": "int"}, [float("inf")], "a is inf, not a whole number"),
        ({"a": ["x", "y"]}, [2.0], r"a 2 is none of 0 \(x\) … 1 \(y\)"),
    ],
)
def test_a_number_that_stands_for_nothing_is_refused(declaration, numbers, sentence):
    with pytest.raises(ValueError, match=sentence):
        RawLayout("T/1", Types({"T/1": declaration})).unflatten(numbers)
