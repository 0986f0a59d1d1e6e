"""What a faulty publisher makes of the outputs it gets."""

import time

import msgspec
import pytest

from stepbus_participant import MessageFault
from stepbus_participant.session.faulty import FaultyPublisher
from stepbus_schemas import Decoder, MessageError, Outputs, encode

decode = Decoder(Outputs)


def message(step):
    ports = {"command": msgspec.Raw(b"\xc0")}
    return encode(Outputs(token="t", step=step, t_ns=5 * max(step, 0), ports=ports))


def published(kind, *steps):
    """Return what goes out when steps are published and step 2 has a fault."""
    out = []
    publish = FaultyPublisher(out.append, [MessageFault(type=kind, step=2, duration_s=0.001)], time)
    for step in steps:
        publish(message(step))
    return out


@pytest.mark.parametrize(
    ("kind", "steps"),
    [
        ("drop", [-1, 0, 1, 3]),
        ("duplicate", [-1, 0, 1, 2, 2, 3]),
        ("reorder", [-1, 0, 1, 3, 2]),
        ("delay", [-1, 0, 1, 2, 3]),
    ],
)
def test_messages_go_out_as_the_fault_says(kind, steps):
    assert published(kind, -1, 0, 1, 2, 3) == [message(step) for step in steps]


def test_a_corrupt_message_cannot_be_decoded():
    out = published("corrupt", 1, 2, 3)
    assert (out[0], out[2]) == (message(1), message(3))
    with pytest.raises(MessageError):
        decode(out[1])


def test_an_oversize_message_says_the_same_and_is_a_mebibyte_longer():
    (large,) = published("oversize", 2)
    assert len(large) > 1 << 20
    assert decode(large) == decode(message(2))
