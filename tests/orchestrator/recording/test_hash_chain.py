"""The hash chain is that of the specification (P13.2)."""

from hashlib import sha256

from mcap.reader import make_reader

from stepbus_orchestrator.recording.chains import HashChain
from stepbus_schemas import Decoder
from stepbus_schemas.protocol import Chain


def chain_of(*steps):
    chain = HashChain()
    for step, published in steps:
        chain.extend(step, published)
    return chain.value


def test_each_value_takes_in_the_one_before_the_step_and_each_port_with_its_bytes():
    first = sha256(bytes(32) + b"\0" * 8 + b"a" + b"x").digest()
    step = b"\x02\x01\0\0\0\0\0\0"
    expected = sha256(first + step + b"a" + b"one" + "ü".encode() + b"two").digest()
    assert chain_of((0, [("a", b"x")]), (258, [("a", b"one"), ("ü", b"two")])) == expected


def test_a_recording_holds_the_chain_of_its_own_messages(two_link_recording):
    with two_link_recording.open("rb") as file:
        rows = [(c.topic, m.sequence, m.data) for _, c, m in make_reader(file).iter_messages()]
    published = {}
    for topic, step, data in rows:
        name, _, port = topic.partition("/")
        published.setdefault(name, {}).setdefault(step, []).append((port, data))
    last = Decoder(Chain)([data for topic, _, data in rows if topic == "stepbus/chain"][-1])
    assert {n: chain_of(*published[n].items()).hex() for n in last.hashes} == last.hashes
