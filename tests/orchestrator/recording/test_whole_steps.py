"""A recording that was ended anywhere holds whole steps only, and says which one it left out."""

import random
from collections import Counter

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.messages.recordings import messages, rewrite
from support.properties import examples

from stepbus_orchestrator.recording import McapFile, Recording, layout, recover

STEPS = 700
TOPICS = ("plant/a", "plant/b", "controller/command", "controller/status")
SHARED_FOLDER = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(60)
)


def fill(path, flush_every):
    """Write a recording as a run does, up to the last step but its chain; return the open file."""
    chance, file = random.Random(7), McapFile(path)
    channels = [file.add_channel(topic, "Event/1", {}) for topic in TOPICS]
    chain = file.add_channel(layout.CHAIN_TOPIC, layout.CHAIN_TYPE, {})
    for step in range(STEPS):
        content = [(c, chance.randbytes(chance.randrange(150))) for c in channels]
        file.add_all(content, step * 1000, step)
        if layout.has_chain(step):
            file.add(chain, step * 1000, b"\x80", step)
        if step % flush_every == 0:
            file.flush()
    return file


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """Return the bytes of a recording that was killed, of a whole one, and its messages."""
    path = tmp_path_factory.mktemp("ended") / "run.mcap"
    file = fill(path, 5)
    killed = path.read_bytes()
    file.close()
    return killed, path.read_bytes(), messages(path)


def up_to(rows, end):
    return [row for row in rows if row[2] < end]


@pytest.mark.slow
@pytest.mark.parametrize("is_closed", [False, pytest.param(True, marks=pytest.mark.slow)])
@SHARED_FOLDER
@given(share=st.floats(0.01, 1, exclude_max=True))
def test_a_cut_anywhere_leaves_whole_steps(ended, tmp_path, is_closed, share):
    data, rows = ended[is_closed], ended[2]
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(share * len(data))])
    recovery = recover(cut, tmp_path / "fixed.mcap", in_place=True)
    assert messages(recovery.target) == up_to(rows, recovery.last_step + 1)
    with Recording(cut) as recording:
        assert recording.last_step == recovery.last_step
        counted = Counter(len(port) for name, port in recording.ports.items() if name in TOPICS)
        told = f"step {recovery.last_step + 1}, the last one, is incomplete and was skipped"
        assert (told in recording.damage) == (recovery.cut_step is not None)
    assert set(counted) <= {recovery.last_step + 1}
    assert recovery.cut_step in {None, recovery.last_step + 1}
    with Recording(recovery.target) as fixed:
        assert (fixed.damage, fixed.last_step) == ("", recovery.last_step)


@pytest.mark.parametrize("library", ["stepbus", "stepbus 2"])
def test_older_recordings_may_end_within_a_step_though_they_have_an_index(ended, tmp_path, library):
    path = tmp_path / "whole.mcap"
    path.write_bytes(ended[1])
    old = rewrite(
        path,
        tmp_path / "old.mcap",
        4096,
        lambda topic, step: step > 650 or (step == 650 and topic.startswith("controller")),
        library=library,
        enable_data_crcs=True,
    )
    told = "step 650, the last one, is incomplete and was skipped"
    with Recording(old) as recording:
        assert (recording.damage, recording.last_step) == (told, 649)
        assert recording["plant/b"].last_step == 649
        assert [len(recording[topic]) for topic in TOPICS] == [650] * 4
    recovery = recover(old, tmp_path / "fixed.mcap")
    assert (recovery.cut_step, recovery.last_step, recovery.damage) == (650, 649, "")
    assert messages(recovery.target) == up_to(ended[2], 650)
    with Recording(recovery.target) as fixed:
        assert (fixed.damage, fixed.last_step) == ("", 649)


def test_an_older_recording_that_ends_with_its_chain_is_whole(ended, tmp_path):
    path = tmp_path / "whole.mcap"
    path.write_bytes(ended[1])
    old = rewrite(path, tmp_path / "old.mcap", 4096, lambda _, step: step > 639, library="stepbus")
    assert (Recording(old).damage, Recording(old).last_step) == ("", 639)
    assert recover(old, tmp_path / "fixed.mcap").cut_step is None
