"""The order in which the mcap library reads a recording, as docs/guide/looking says."""

import pytest
from mcap.reader import make_reader
from support.runs.joints import run_joints

STEP_NS = 5_000_000


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    return run_joints(folder, "duration=50ms", in_process=True).recording


def read(recording, **choice):
    with recording.open("rb") as file:
        messages = make_reader(file).iter_messages(**choice)
        return [(message.log_time // STEP_NS, channel.topic) for _, channel, message in messages]


def test_a_step_has_one_time_and_the_order_of_its_participants(recording):
    rows = read(recording)
    assert rows[:4] == [
        (0, "plant/joint_state"),
        (0, "mission/reference"),
        (0, "controller/command"),
        (1, "plant/joint_state"),
    ]
    assert rows == read(recording, log_time_order=False)


def test_reverse_turns_a_step_around_too(recording):
    assert read(recording, reverse=True) == read(recording)[::-1]


def test_what_an_end_includes(recording):
    rows = read(recording)
    assert read(recording, ending_at=3 * STEP_NS) == [row for row in rows if row[0] <= 3]
    assert read(recording, ending_before=3 * STEP_NS) == [row for row in rows if row[0] < 3]
    assert read(recording, starting_after=3 * STEP_NS) == [row for row in rows if row[0] > 3]
    with pytest.deprecated_call():
        assert read(recording, start_time=2 * STEP_NS, end_time=3 * STEP_NS) == [
            row for row in rows if row[0] == 2
        ]
