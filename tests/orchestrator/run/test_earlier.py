"""Participants of protocol 1 get and send its names; others notice nothing."""

import msgspec
import pytest
from support.messages.fuzz import HandBus
from support.runs.kernel import TOKEN, scenario

from stepbus_orchestrator.run.bus import Session, subscribe
from stepbus_participant import Sample
from stepbus_schemas import Call, Fault, Refusal, Start, Welcome, encode, encoding_of

FAULT = Fault(name="plant", token=TOKEN, step=3, type="raised", message="too hot")


class Bus(HandBus):
    """Keeps what is published: (key, fields)."""

    def __init__(self):
        super().__init__()
        self.published = []

    def publisher(self, key, encoding, *, remote=False):
        return lambda data, attachment=b"": self.published.append(
            (key, msgspec.msgpack.decode(data))
        )


class Request:
    """A query that keeps no reply."""

    payload = b""

    def reply(self, data, encoding):
        self.replied = data


class Messages:
    """Keeps the faults that it is given."""

    def __init__(self):
        self.faults = []

    def __getattr__(self, name):
        return lambda *_: None

    def take_fault(self, name, data):
        self.faults.append((name, data))


class Nothing:
    """A safe stop of no participant."""

    names = ()


def welcome(protocol):
    return Welcome(
        protocol=protocol, name="plant", token=TOKEN, step_ns=1, every=1, publishes="last", window=1,
        batch=1, seed=0, inputs={}, outputs={}, params={}, folder="/",
    )  # fmt: skip


@pytest.fixture
def session():
    session = Session(scenario(), Bus(), TOKEN)
    yield session
    session.announcer.close()


def trigger(session, *answers):
    for answer in answers:
        session.announcer.reply(Request(), answer)
    session.announcer.trigger(7)
    return session.bus.published[-1]


def test_a_trigger_has_both_names_once_a_participant_of_protocol_1_is_admitted(session):
    both = {"token": TOKEN, "step_limit": 7, "upto": 7}
    assert trigger(session, welcome(1), welcome(2)) == ("trigger", both)


@pytest.mark.parametrize("answers", [[], [welcome(2)], [Refusal(reason="no")]])
def test_without_one_a_trigger_is_as_ever(session, answers):
    assert trigger(session, *answers) == ("trigger", {"token": TOKEN, "step_limit": 7})


def test_a_call_has_both_names_and_a_start_stays_as_it_is(session):
    session.announcer.reply(Request(), welcome(1))
    session.announcer.start(encode(Start(token=TOKEN, inputs={})))
    session.announcer.publisher("call/plant", "Call/1")(
        encode(Call(token=TOKEN, id=1, method="pose"))
    )
    assert session.bus.published == [
        ("start", {"token": TOKEN, "inputs": {}}),
        ("call/plant", {"token": TOKEN, "id": 1, "method": "pose", "verb": "pose"}),
    ]


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_fault_with_earlier_names_is_read_where_such_a_participant_is_there(session, protocol):
    messages = Messages()
    subscribe(session, messages, Nothing())
    session.announcer.reply(Request(), welcome(protocol))
    earlier = encode(FAULT).replace(b"\xa4type", b"\xa4kind")
    session.bus.hand(Sample("fault/plant", earlier, b"", encoding_of("Fault/1")))
    session.inbox.receive(0)
    assert messages.faults == [("plant", encode(FAULT) if protocol == 1 else earlier)]
