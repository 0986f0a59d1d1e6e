"""However a recording is damaged or forged, each reader is right or says what is wrong."""

import random

import pytest
from campaign.mutations import MUTATIONS
from campaign.readers import read_all
from support.messages.recordings import chunks

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.replay import replay as replay_participant


@pytest.mark.parametrize("mutation", MUTATIONS)
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in range(1, 8))]
)
def test_no_reader_is_wrong_about_a_mutated_recording(two_link_recording, tmp_path, mutation, seed):
    chance = random.Random(f"{mutation} {seed}")
    assert list(read_all(mutation, chance, two_link_recording, tmp_path, "controller")) == []


def test_a_recording_damaged_before_its_channels_is_not_replayed(two_link_recording, tmp_path):
    data = two_link_recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: chunks(data)[0][0] + 20])
    with pytest.raises(RecordingFailed, match="has no complete step of controller"):
        replay_participant(cut, "controller")
