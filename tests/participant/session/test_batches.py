"""Several steps in one message, from a participant that nobody waits for (P7.6)."""

import time
from collections import defaultdict

import msgspec
import pytest

from stepbus_participant.inputs import Input, PeerFault, make_sources
from stepbus_participant.session.outbox import BATCH_BYTES, HOLD_NS, Outbox
from stepbus_schemas import (
    Batch,
    Decoder,
    InputConfig,
    JointState,
    Log,
    OutputConfig,
    Outputs,
    Welcome,
    encode,
)

TOKEN = "00c0ffee00c0ffee"
STATE = JointState(position=[0.5], velocity=[0.0])
_batch, _outputs, _log = Decoder(Batch), Decoder(Outputs), Decoder(Log)


class Bus:
    """Keeps what is published, by key, and all in their order."""

    clock, exchange = time, None

    def __init__(self):
        self.sent = defaultdict(list)
        self.order = []

    def publisher(self, key, _encoding):
        def put(data):
            self.sent[key].append(data)
            self.order.append(key)

        return put


def outbox(bus, most, *, batch=100):
    made = Outbox(
        Welcome(
            protocol=2, name="mission", token=TOKEN, step_ns=5, every=1, publishes="last",
            window=64, batch=batch, seed=0, inputs={}, params={}, folder="/",
            outputs={"state": OutputConfig(type="JointState/1")},
        ),
        bus,
        {},
    )  # fmt: skip
    made.start({}, {}, most)
    return made


def steps_of(message):
    """Return the steps in one message on `out/mission`."""
    try:
        return [_outputs(raw).step for raw in _batch(message).outputs]
    except ValueError:
        return [_outputs(message).step]


@pytest.mark.parametrize(
    ("most", "compute_ns", "sent"),
    [
        (3, 1000, [[0, 1, 2], [3, 4, 5], [6]]),
        (1, 1000, [[step] for step in range(7)]),
        (32, HOLD_NS + 1, [[step] for step in range(7)]),
    ],
    ids=["permitted", "without permission", "slow steps"],
)
def test_steps_go_out_together_as_many_as_are_permitted(most, compute_ns, sent):
    bus = Bus()
    box = outbox(bus, most)
    for step in range(7):
        box.publish(step, {"state": STATE})
        box.finish(step, 0, compute_ns)
    box.send_held()
    assert [steps_of(message) for message in bus.sent["out/mission"]] == sent


def test_a_batch_stays_below_the_limit_of_the_transport():
    bus = Bus()
    box = outbox(bus, 1000, batch=1000)
    large = JointState(position=[0.5] * 600, velocity=[0.0] * 600)
    for step in range(12):
        box.publish(step, {"state": large})
        box.finish(step, 0, 1)
    box.send_held()
    messages = bus.sent["out/mission"]
    assert [step for message in messages for step in steps_of(message)] == list(range(12))
    assert max(map(len, messages)) < BATCH_BYTES + 1000


def test_nothing_is_logged_before_it_is_published():
    bus = Bus()
    box = outbox(bus, 32)
    for step in range(4):
        box.publish(step, {"state": STATE})
    box.flush()
    assert bus.order == ["out/mission", "log/mission"]
    (batch,), (log,) = bus.sent["out/mission"], bus.sent["log/mission"]
    # Byte for byte the same entries (P9.1).
    assert _batch(batch).outputs == _log(log).outputs


def source(delay=0):
    config = InputConfig(source="mission", port="state", type="JointState/1", delay=delay)
    item = Input("x", config)
    (made,) = make_sources({"x": item}, TOKEN)
    return made, item


def entry(step, *, token=TOKEN, ports=None):
    state = {"state": msgspec.Raw(encode(STATE))} if ports is None else ports
    return msgspec.Raw(encode(Outputs(token=token, step=step, t_ns=5 * step, ports=state)))


def batch(*entries, token=TOKEN):
    return encode(Batch(token=token, outputs=list(entries)))


def take_all(made):
    while made.entries:
        made.accept(made.entries.popleft())


def test_the_entries_of_a_batch_count_as_messages_of_their_own():
    made, _ = source()
    assert made.accept(batch(entry(0), entry(0), entry(1))) is None
    take_all(made)
    assert (made.step, made.drops) == (1, {"duplicate": 1})


def test_a_batch_of_another_run_is_dropped_whole():
    made, _ = source()
    made.accept(batch(entry(0), token="another"))
    made.accept(batch(entry(0, token="another")))
    take_all(made)
    assert (made.step, made.drops) == (-1, {"unauthenticated": 2})


def test_a_batch_in_a_batch_is_a_fault_of_its_source():
    made, _ = source()
    made.accept(batch(msgspec.Raw(batch(entry(0)))))
    with pytest.raises(PeerFault, match="after step -1: mission sent"):
        take_all(made)


def test_a_gap_in_a_batch_is_seen_when_the_step_behind_it_is_needed():
    made, _ = source()
    made.accept(batch(entry(0), entry(2)))
    assert made.accept(made.entries.popleft()).step == 0
    with pytest.raises(PeerFault, match="skipped from step 0 to 2"):
        made.accept(made.entries.popleft())
