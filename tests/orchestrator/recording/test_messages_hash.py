"""The hash of all messages: what it covers, what does not change it, how others compute it."""

import hashlib

import pytest
from mcap.reader import make_reader
from support.runs.joints import run_joints

from stepbus_orchestrator.recording import Recording


def by_another_reader(recording):
    """Return it as the protocol page has it: the SHA-256 of the last message of stepbus/chain."""
    with recording.open("rb") as file:
        *_, (_, _, last) = make_reader(file).iter_messages(topics=["stepbus/chain"])
    return hashlib.sha256(last.data).hexdigest()


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return run_joints(tmp_path_factory.mktemp("plain"), in_process=True)


def test_run_and_recording_have_the_hash_that_another_reader_computes(plain):
    assert plain.messages_sha256 == by_another_reader(plain.recording)
    with Recording(plain.recording) as recording:
        assert recording.messages_sha256 == plain.messages_sha256


def test_what_is_no_message_changes_the_hash_of_the_file_only(tmp_path, plain):
    renamed = run_joints(tmp_path, "name=other", in_process=True)
    assert renamed.sha256 != plain.sha256
    assert renamed.messages_sha256 == plain.messages_sha256


def test_a_recording_without_its_end_has_none(tmp_path, plain):
    data = plain.recording.read_bytes()
    half = tmp_path / "half.mcap"
    half.write_bytes(data[: len(data) // 2])
    with Recording(half) as recording:
        assert recording.messages_sha256 == ""


def test_another_message_or_another_number_of_steps_changes_it(tmp_path, plain):
    other = run_joints(tmp_path / "other", "mission.every=5", in_process=True)
    shorter = run_joints(tmp_path / "shorter", "duration=100ms", in_process=True)
    assert len({r.messages_sha256 for r in (plain, other, shorter)}) == 3
