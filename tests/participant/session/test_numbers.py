"""Which protocol numbers a participant of the Python library names, and which `Welcome` it takes."""

import time
from types import SimpleNamespace

import msgspec
import pytest

from stepbus_participant import Endpoint, Ticket
from stepbus_participant.session.admission import AdmissionRefused, join
from stepbus_schemas import Decoder, Hello, Protocols, Welcome, encode

WELCOME = Welcome(
    protocol=2, name="plant", token="00", step_ns=1, every=1, publishes="last", window=1, batch=1,
    seed=0, inputs={}, outputs={}, params={}, folder="/",
)  # fmt: skip
TICKET = Ticket(run="r", name="plant", token="00", endpoint=Endpoint(listen=[], connect=[]))


def asked(spoken, ticket=TICKET, answer=2):
    """Return the numbers of the `Hello` and of the `Welcome` that is taken."""
    hellos = []

    def query(_key, data, *_):
        hellos.append(Decoder(Hello)(data))
        return [encode(msgspec.structs.replace(WELCOME, protocol=answer))]

    taken = join(SimpleNamespace(clock=time, query=query), ticket, spoken=Protocols(*spoken))
    return hellos[0].protocol, hellos[0].lowest_protocol, taken.protocol


def of(*protocols):
    return msgspec.structs.replace(TICKET, protocols=Protocols(*protocols))


@pytest.mark.parametrize(
    ("spoken", "ticket", "numbers"),
    [
        ((2, 2), TICKET, (2, None)),
        ((2, 3), TICKET, (2, None)),
        ((1, 3), TICKET, (2, 1)),
        ((1, 3), of(2, 4), (3, 1)),
        ((2, 3), of(1, 9), (3, 2)),
        ((2, 2), of(3, 4), (2, None)),
    ],
)
def test_a_hello_names_the_highest_number_that_the_ticket_has_too(spoken, ticket, numbers):
    assert asked(spoken, ticket) == (*numbers, 2)


@pytest.mark.parametrize("answer", [1, 4])
def test_a_welcome_of_a_number_that_it_does_not_speak_is_refused(answer):
    sentence = (
        f"the orchestrator speaks protocol {answer}, this program protocols 2 to 3; use versions"
    )
    with pytest.raises(AdmissionRefused, match=sentence):
        asked((2, 3), answer=answer)


def test_a_ticket_without_protocols_is_of_an_orchestrator_that_speaks_2():
    old = msgspec.json.decode(msgspec.json.encode(TICKET))
    del old["protocols"]
    assert msgspec.convert(old, Ticket).protocols == Protocols(2, 2)


def test_a_ticket_names_the_protocols_of_the_orchestrator(tmp_path):
    of(1, 2).save(tmp_path / "ticket")
    text = msgspec.json.decode((tmp_path / "ticket").read_bytes())
    assert text["protocols"] == {"lowest": 1, "highest": 2}
