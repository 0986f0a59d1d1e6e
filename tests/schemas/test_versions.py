"""Ranges of protocol numbers, and messages with the names of earlier ones."""

import msgspec
import pytest

from stepbus_schemas import (
    MESSAGE_TYPES,
    PROTOCOL_VERSION,
    RENAMED_FIELDS,
    SERVED,
    SPOKEN,
    Decoder,
    Fault,
    Hello,
    Protocols,
    Trigger,
    encode,
    offered,
    renamed_fields,
    served,
    with_earlier_names,
    with_present_names,
)
from stepbus_schemas.generate import broken, published_vectors

FAULT = Fault(name="plant", token="00", step=3, type="raised", message="too hot")


@pytest.mark.parametrize(
    ("one", "other", "number"),
    [
        ((2, 2), (1, 2), 2),
        ((2, 3), (1, 2), 2),
        ((1, 1), (1, 2), 1),
        ((1, 9), (1, 2), 2),
        ((3, 4), (1, 2), None),
        ((0, 0), (1, 2), None),
        ((2, 1), (1, 2), None),
    ],
)
def test_two_ranges_have_their_highest_common_number(one, other, number):
    assert Protocols(*one).common(Protocols(*other)) == number
    assert Protocols(*other).common(Protocols(*one)) == number


@pytest.mark.parametrize(
    ("fields", "numbers"), [({}, (2, 2)), ({"lowest_protocol": 1}, (1, 2)), ({"lowest_protocol": 2}, (2, 2))]
)  # fmt: skip
def test_a_hello_that_names_one_number_offers_that_alone(fields, numbers):
    hello = Hello(protocol=2, name="plant", token="00", pid=7, **fields)
    assert offered(hello) == Protocols(*numbers)


def test_a_range_is_shown_with_its_ends():
    assert [str(Protocols(2, 2)), str(Protocols(1, 3))] == ["protocol 2", "protocols 1 to 3"]


def test_the_present_number_is_spoken_and_served():
    assert SPOKEN.highest == SERVED.highest == PROTOCOL_VERSION


def test_every_served_number_differs_from_the_present_one_by_the_listed_names_only():
    for number in range(SERVED.lowest, PROTOCOL_VERSION):
        changed = (set(RENAMED_FIELDS[later]) for later in RENAMED_FIELDS if later > number)
        assert set().union(*changed) == set(broken(published_vectors(number)))


@pytest.mark.parametrize("number", range(SERVED.lowest, PROTOCOL_VERSION))
def test_what_a_served_number_sends_is_read_with_the_present_names(number):
    decode, renamed = Decoder(Fault), renamed_fields("Fault/1")
    vectors = published_vectors(number)["Fault/1"]["exact"]
    read = [decode(with_present_names(bytes.fromhex(data), renamed)) for data in vectors]
    assert [fault.type for fault in read].count("") == 0 < len(read)


def test_only_port_types_that_were_renamed_keep_earlier_numbers_out():
    lowest = {name: served([name]).lowest for name in MESSAGE_TYPES}
    assert {name for name, number in lowest.items() if number > SERVED.lowest} == {
        "Detections/1",
        "Goal/1",
    }
    assert served(["JointState/1", "Goal/1"]) == Protocols(2, 2)
    assert served([]) == SERVED


def test_a_trigger_with_earlier_names_is_read_by_both_numbers():
    data = with_earlier_names(
        encode(Trigger(token="00", step_limit=7)), renamed_fields("Trigger/1")
    )
    assert msgspec.msgpack.decode(data) == {"token": "00", "step_limit": 7, "upto": 7}
    assert Decoder(Trigger)(data) == Trigger(token="00", step_limit=7)


def test_a_fault_with_earlier_names_gets_the_present_ones():
    earlier = encode(FAULT).replace(b"\xa4type", b"\xa4kind")
    assert Decoder(Fault)(with_present_names(earlier, renamed_fields("Fault/1"))) == FAULT
    assert with_present_names(encode(FAULT), renamed_fields("Fault/1")) == encode(FAULT)


@pytest.mark.parametrize("data", [b"", b"\xc1", b"\x07", b"\x81\xa4kind"])
def test_what_is_no_map_stays_as_it_is(data):
    assert with_present_names(data, renamed_fields("Fault/1")) == data
