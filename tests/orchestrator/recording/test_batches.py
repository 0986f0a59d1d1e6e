"""A recording in pieces of whole steps."""

import numpy as np
from support.messages.recordings import write

from stepbus_orchestrator.recording import Recording
from stepbus_schemas import JointState


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
