"""Recordings of earlier protocol numbers are read, compared and replayed in the names of today."""

import pytest
from support.messages.recordings import write

from stepbus_orchestrator.recording import recorded_decoder
from stepbus_orchestrator.recording.reader import Recording
from stepbus_orchestrator.replay.recorded import Track
from stepbus_orchestrator.run.extensions.calls import recorded_calls
from stepbus_schemas import (
    ENVELOPE_TYPES,
    MESSAGE_TYPES,
    PROTOCOL_VERSION,
    Decoder,
    Description,
    Goal,
    encode,
)
from stepbus_schemas.generate import published_vectors

RECORDED = {name: ENVELOPE_TYPES[name] for name in ("CallRecord/1", "Chain/1")} | MESSAGE_TYPES
OLD_GOAL = {"id": 3, "kind": "stop"}


@pytest.mark.parametrize("number", range(1, PROTOCOL_VERSION + 1))
def test_every_message_that_was_ever_recorded_can_be_read(number):
    vectors = published_vectors(number)
    for name in RECORDED.keys() & vectors.keys():
        decode = recorded_decoder(RECORDED[name])
        read = [encode(decode(bytes.fromhex(data))) for data in vectors[name]["exact"]]
        assert all(read)


def test_a_recording_of_protocol_1_is_read_as_arrays_and_messages(tmp_path):
    path = write(tmp_path / "run.mcap", goal=("Goal/1", Description(), [OLD_GOAL] * 3))
    with Recording(path) as recording:
        port = recording["plant/goal"]
        assert list(port["type"]) == ["stop"] * 3
        assert [message for _, message in port.messages()] == [Goal(id=3, type="stop")] * 3


def test_a_participant_of_today_is_compared_with_a_recording_of_protocol_1(tmp_path):
    old = write(tmp_path / "old.mcap", goal=("Goal/1", Description(), [OLD_GOAL]))
    with Recording(old) as recording:
        data = Track(recording, "plant/goal").take(0)
    assert Decoder(Goal)(data) == Goal(id=3, type="stop")
    assert data == encode(Goal(id=3, type="stop"))


def test_calls_of_a_recording_of_protocol_1_are_made_again(tmp_path):
    call = {"step": 4, "participant": "plant", "verb": "teleport", "args": [1]}
    path = write(tmp_path / "run.mcap", calls=("CallRecord/1", Description(), [call]))
    with Recording(path) as recording:
        recording.ports = {"stepbus/calls": recording["plant/calls"]}
        assert [one.method for one in recorded_calls(recording)] == ["teleport"]
