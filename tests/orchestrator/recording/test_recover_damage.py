"""A recording cut off or spoilt anywhere gives back every record that is whole."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.messages.recordings import attachments, messages, metadata, record_ends, rewrite
from support.properties import examples

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import recover

SHARED_FOLDER = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(60)
)


@pytest.fixture(scope="session")
def chunked(two_link_recording, tmp_path_factory):
    """Return the recording again, in so many chunks that cuts fall between them."""
    return rewrite(two_link_recording, tmp_path_factory.mktemp("chunked") / "run.mcap", 16384)


def recover_bytes(folder, data):
    broken, fixed = folder / "broken.mcap", folder / "fixed.mcap"
    broken.write_bytes(data)
    return recover(broken, fixed, in_place=True)


def first_chunk(data, further=0):
    """Return where the first chunk begins, or a further record behind it."""
    ends = record_ends(data)
    return ends[next(index for index, end in enumerate(ends) if data[end] == 0x06) + further]


def kept_or_refused(folder, data):
    """Return the messages that came back; none where there was nothing to recover."""
    try:
        return messages(recover_bytes(folder, data).target)
    except RecordingFailed:
        return []


@pytest.mark.slow
def test_a_cut_at_and_beside_every_record_loses_no_whole_record(chunked, tmp_path):
    data, original = chunked.read_bytes(), messages(chunked)
    kept = 0
    for end in record_ends(data):
        shorter = [kept_or_refused(tmp_path, data[: end + more]) for more in (-1, 0, 1)]
        assert shorter[0] == original[:kept]
        assert shorter[1] == shorter[2] == original[: len(shorter[1])]
        assert len(shorter[1]) >= kept
        kept = len(shorter[1])
    assert kept == len(original)


@SHARED_FOLDER
@given(share=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_wrong_bit_in_a_chunk_never_gives_a_wrong_message(chunked, tmp_path, share, bit):
    data, original = bytearray(chunked.read_bytes()), messages(chunked)
    data[first_chunk(data) + 9 + int(share * 3000)] ^= 1 << bit
    kept = kept_or_refused(tmp_path, bytes(data))
    assert kept == original[: len(kept)]


@pytest.mark.parametrize("tail", [b"\0" * 5000, bytes(range(150, 256)) * 50, b"\x05" + b"\xff" * 8])
def test_rubbish_behind_the_cut_is_left_out(chunked, tmp_path, tail):
    data = chunked.read_bytes()
    cut = first_chunk(data, further=1)
    clean, spoilt = (kept_or_refused(tmp_path, data[:cut] + more) for more in (b"", tail))
    assert len(clean) > 0
    assert spoilt == clean


def test_a_cut_recording_keeps_its_scenario_and_versions(chunked, tmp_path):
    data = chunked.read_bytes()
    recovery = recover_bytes(tmp_path, data[: len(data) // 2])
    assert attachments(recovery.target) == attachments(chunked)
    assert metadata(recovery.target) == metadata(chunked)


def test_what_was_lost_is_counted_in_steps_and_bytes(chunked, tmp_path):
    data = chunked.read_bytes()
    recovery = recover_bytes(tmp_path, data[: len(data) // 2])
    assert recovery.kept_bytes + recovery.lost_bytes == len(data) // 2
    assert recovery.planned_steps == 60
    assert recovery.missing_steps == 59 - recovery.last_step > 0


def test_a_recording_that_lacks_only_its_index_has_lost_no_step(chunked, tmp_path):
    recovery = recover_bytes(tmp_path, chunked.read_bytes()[:-1])
    assert (recovery.only_index_lost, recovery.missing_steps) == (True, 0)
    assert messages(recovery.target) == messages(chunked)


def test_an_undamaged_recording_comes_back_byte_for_byte(two_link_recording, tmp_path):
    recovery = recover(two_link_recording, tmp_path / "fixed.mcap")
    assert recovery.damage == ""
    assert recovery.target.read_bytes() == two_link_recording.read_bytes()
