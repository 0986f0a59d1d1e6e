"""Fields of many messages at once, and a recording in pieces of whole steps."""

import numpy as np
import pytest
from support.messages.recordings import write

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.recording.reader.columns import array_of, columns
from stepbus_schemas import SHIPPED, Decoder, JointCommand, JointState, MessageError, encode

FIELDS = {"JointState/1": ("position", "velocity", "target"), "JointCommand/1": ("mode", "values")}
CASES = [
    [JointState(position=[0.1 * n, -n]) for n in range(5)],
    [JointState(position=[0.1 * n, -1.5], velocity=[n / 3, np.inf]) for n in range(5)],
    [JointState(position=[float("nan")], target=[1e300])],
    [JointState(position=[0.5] * (n % 2 + 1)) for n in range(5)],
    [JointState(position=[0.5], velocity=[1.0] if n else None) for n in range(5)],
    [JointState(position=[1, 0.5]), JointState(position=[0.5, 1])],
    [JointState(position=[])] * 3,
    [JointState(position=[0.5 * n] * 16) for n in range(3)],
    [JointState()] * 3,
    [JointCommand(mode="torque", values=[0.5 * n]) for n in range(4)],
    [JointCommand(mode=mode, values=[0.5]) for mode in ("torque", "brake")],
    [],
]


def by_one(type_name, messages):
    """Return what decoding the messages one by one gives."""
    decoded = [Decoder(SHIPPED[type_name])(data) for data in messages]
    return {f: array_of([getattr(m, f) for m in decoded]) for f in FIELDS[type_name]}


@pytest.mark.parametrize("messages", CASES)
def test_columns_are_what_decoding_one_by_one_gives(messages):
    type_name = (
        "JointCommand/1" if isinstance((messages or [0])[0], JointCommand) else "JointState/1"
    )
    data = [encode(message) for message in messages]
    expected = by_one(type_name, data)
    read = columns(SHIPPED[type_name], data, FIELDS[type_name])
    found = {field: array_of(column) for field, column in read.items()}
    assert found.keys() == expected.keys()
    for field, values in expected.items():
        if values is None:
            assert found[field] is None
            continue
        assert (found[field].dtype, found[field].shape) == (values.dtype, values.shape)
        assert [repr(v) for v in found[field].flat] == [repr(v) for v in values.flat]


def test_a_broken_message_among_equal_ones_is_reported():
    data = [encode(JointState(position=[0.5]))] * 3
    broken = data[0].replace(b"position", b"positiom"), data[0][:-9] + b"\xcf" + data[0][-8:]
    columns(JointState, [*data, broken[0]], ["position"])
    with pytest.raises(MessageError):
        columns(JointState, [data[0], data[0][:-1], data[0]], ["position"])
    with pytest.raises(MessageError):
        columns(JointState, [b"\xc1", *data], ["position"])


def test_a_batch_has_all_messages_of_its_steps(tmp_path):
    states = [JointState(position=[0.1 * n]) for n in range(40)]
    sparse = [JointState(position=[0.1 * n]) if n % 3 == 0 else None for n in range(40)]
    ports = {"a": ("JointState/1", ["j"], states), "b": ("JointState/1", ["j"], sparse)}
    recording = Recording(write(tmp_path / "run.mcap", **ports))
    found = list(recording.batches(recording.ports.values(), most_bytes=100))
    assert len(found) > 5
    for topic in ("plant/a", "plant/b"):
        steps = np.concatenate([batch[topic].steps for batch in found])
        assert (steps == recording[topic].steps).all()
    last = [max(batch[topic].steps.max(initial=-1) for topic in batch) for batch in found]
    first = [min(batch[topic].steps.min(initial=99) for topic in batch) for batch in found]
    assert all(a < b for a, b in zip(last[:-1], first[1:], strict=True))
