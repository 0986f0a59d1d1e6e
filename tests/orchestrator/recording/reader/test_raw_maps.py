"""Plain maps of recorded messages, decoded by a codec apart from ours."""

import pytest
from hypothesis import given
from support.messages.recordings import write
from support.messages.vectors import load_vectors, messages

from stepbus_orchestrator.recording import raw_map
from stepbus_orchestrator.recording.reader import Recording
from stepbus_schemas import Description, JointState, MessageError, encode
from stepbus_tools.conformance.transcript import disagreement

TAKEN = [
    bytes.fromhex(row["hex"])
    for groups in load_vectors().values()
    for group in ("exact", "accepted")
    for row in groups[group]
]


def test_a_port_yields_plain_maps_as_its_bytes_are(tmp_path):
    states = [JointState(position=[0.5]), JointState(position=[1.0], velocity=[2.0])]
    path = write(tmp_path / "run.mcap", joint_state=("JointState/1", ["a"], states))
    with Recording(path) as recording:
        assert list(recording["plant.joint_state"].maps()) == [
            (0, {"position": [0.5]}), (1, {"position": [1.0], "velocity": [2.0]}),
        ]  # fmt: skip


def test_what_is_no_port_message_has_maps_too(tmp_path):
    path = write(tmp_path / "run.mcap", odd=("Chain/1", Description(), [{"x": [1, {"y": None}]}]))
    with Recording(path) as recording:
        assert list(recording["plant.odd"].maps()) == [(0, {"x": [1, {"y": None}]})]


@pytest.mark.parametrize("data", [b"", b"\xc1", b"\x93\x01", b"\x80\x80", b"\x81\xa1a", b"\x07", b"\x81\x90\x01"])  # fmt: skip
def test_bytes_that_are_no_map_are_refused_in_a_sentence(data):
    with pytest.raises(MessageError, match=r"not (a )?MessagePack"):
        raw_map(data)


def test_both_codecs_read_every_vector_the_same():
    assert [data.hex() for data in TAKEN if disagreement(data)] == []


@given(messages("Welcome/1"))
def test_both_codecs_read_any_message_the_same(message):
    assert disagreement(encode(message)) == ""
