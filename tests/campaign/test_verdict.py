"""The judge of mutated recordings finds each wrong answer."""

import random

import pytest
from campaign.log_reader import parse
from campaign.mutations import MUTATIONS
from campaign.readers import Answer, Judge

UNDAMAGED = Answer(0, "run.mcap: undamaged\nkept 3 messages")
EQUAL = Answer(0, "equal: 3 messages")
DAMAGED = Answer(0, "run.mcap: the file ends before its end record")


def judged(recording, mutation, reader, answer):
    before = recording.read_bytes()
    after = MUTATIONS[mutation](random.Random(2), before)
    return list(Judge(mutation, before, after).judge(reader, answer))


@pytest.mark.parametrize(
    ("mutations", "reader", "answer", "problem"),
    [
        (
            ["a bit flipped", "message dropped", "message changed"],
            "recover",
            UNDAMAGED,
            "wrong undamaged",
        ),
        (["rewritten", "attachments changed"], "recover", UNDAMAGED, None),
        (["rewritten"], "recover", DAMAGED, "wrong damage"),
        (["message dropped", "message changed"], "diff", EQUAL, "wrong equal"),
        (["attachments changed"], "diff", EQUAL, None),
    ],
)
def test_an_answer_is_wrong_where_it_is_false(
    two_link_recording, mutations, reader, answer, problem
):
    for mutation in mutations:
        found = judged(two_link_recording, mutation, reader, answer)
        assert problem in found[0] if problem else found == []


@pytest.mark.parametrize(
    "answer", [Answer(1, "stepbus: internal"), Answer(-11, ""), Answer(2, "Traceback (most")]
)
def test_a_traceback_or_crash_is_wrong(two_link_recording, answer):
    assert judged(two_link_recording, "a bit flipped", "read", answer) != []


@pytest.mark.parametrize("name", sorted(MUTATIONS.keys() - {"rewritten"}))
def test_every_mutation_changes_the_file(two_link_recording, name):
    before = MUTATIONS["rewritten"](random.Random(0), two_link_recording.read_bytes())
    assert all(MUTATIONS[name](random.Random(seed), before) != before for seed in range(3))
    assert len(parse(before).rows) == 61 + 3 * 60 + 1
