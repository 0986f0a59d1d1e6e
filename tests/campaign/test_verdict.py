"""The judge of mutated recordings finds each wrong answer."""

import random

import pytest
from campaign.recordings.mutations import (
    MUTATIONS,
    attachment_changed,
    flip,
    message_changed,
    message_dropped,
    rewritten,
)
from campaign.recordings.readers import Answer
from campaign.recordings.verdict import Judge, messages

UNDAMAGED = Answer(0, "run.mcap: undamaged\nkept 3 messages")
EQUAL = Answer(0, "equal: 3 messages")


def judged(recording, mutation, reader, answer):
    before = recording.read_bytes()
    after = mutation(random.Random(2), before)
    return list(Judge(mutation, before, after).judge(reader, answer))


@pytest.mark.parametrize("mutation", [flip, message_dropped, message_changed])
def test_undamaged_is_wrong_for_what_is_damaged_or_forged(two_link_recording, mutation):
    assert "wrong undamaged" in judged(two_link_recording, mutation, "recover", UNDAMAGED)[0]


@pytest.mark.parametrize("mutation", [rewritten, attachment_changed])
def test_undamaged_is_right_for_another_valid_file(two_link_recording, mutation):
    assert judged(two_link_recording, mutation, "recover", UNDAMAGED) == []


def test_damage_is_wrong_for_a_recording_that_was_only_written_again(two_link_recording):
    answer = Answer(0, "run.mcap: the file ends before its end record")
    assert "wrong damage" in judged(two_link_recording, rewritten, "recover", answer)[0]


@pytest.mark.parametrize("mutation", [message_dropped, message_changed])
def test_equal_is_wrong_where_a_message_differs(two_link_recording, mutation):
    assert "wrong equal" in judged(two_link_recording, mutation, "diff", EQUAL)[0]


def test_equal_is_right_where_none_differs(two_link_recording):
    assert judged(two_link_recording, attachment_changed, "diff", EQUAL) == []


@pytest.mark.parametrize(
    "answer", [Answer(1, "stepbus: internal"), Answer(-11, ""), Answer(2, "Traceback (most")]
)
def test_a_traceback_or_crash_is_wrong(two_link_recording, answer):
    assert judged(two_link_recording, flip, "read", answer) != []


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.__name__)
def test_every_mutation_changes_the_file(two_link_recording, mutation):
    before = rewritten(random.Random(0), two_link_recording.read_bytes())
    seeds = range(3) if mutation is not rewritten else ()
    assert all(mutation(random.Random(seed), before) != before for seed in seeds)
    assert len(messages(before)) == 61 + 3 * 60
