"""What is missing in the midst of a recording is found, by every command that reads it."""

import pytest
from support.messages.recordings import rewrite

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.recording import Recording, recover

CHAINS = "controller: the hash chain breaks at or before step 60"


def lacks(topics, steps):
    return lambda topic, step: topic in topics and step in steps


@pytest.fixture
def holed(two_link_recording, tmp_path):
    """Return a recording without the controller's outputs of steps 20 to 24."""
    topics = ("controller/command", "controller/status")
    return rewrite(two_link_recording, tmp_path / "run.mcap", 4096, lacks(topics, range(20, 25)))


def test_a_whole_recording_has_no_hole(two_link_recording, tmp_path):
    assert Recording(two_link_recording).holes() == []
    assert recover(two_link_recording, tmp_path / "fixed.mcap").holes == []


def test_missing_steps_are_found(holed, tmp_path):
    assert Recording(holed).holes() == [CHAINS]
    assert recover(holed, tmp_path / "fixed.mcap").holes == [CHAINS]


@pytest.mark.parametrize("step", [0, 1, 30, 59])
def test_one_message_that_is_missing_is_found(two_link_recording, tmp_path, step):
    only = lacks(["controller/command"], [step])
    holes = Recording(rewrite(two_link_recording, tmp_path / "run.mcap", 4096, only)).holes()
    assert holes[-1] == CHAINS


def test_recover_says_what_is_missing(holed, tmp_path, capsys):
    main(["recover", str(holed), "--out", str(tmp_path / "fixed.mcap")])
    output = capsys.readouterr().out
    assert "run.mcap: it has holes" in output
    assert f"hole: {CHAINS}" in output
    assert "undamaged" not in output


def test_a_replay_of_a_recording_with_a_hole_blames_nobody(holed, capsys):
    assert main(["replay", str(holed), "--participant", "controller"]) == 8
    assert f"has a hole: {CHAINS}" in capsys.readouterr().err


def test_a_comparison_says_which_recording_has_a_hole(holed, two_link_recording, capsys):
    assert main(["diff", str(two_link_recording), str(holed)]) == 10
    assert f"{holed} has a hole: {CHAINS}" in capsys.readouterr().out


def test_info_says_what_is_missing(holed, capsys):
    main(["info", str(holed)])
    output = capsys.readouterr().out
    assert "outcome   recording with holes" in output
    assert f"hole      {CHAINS}" in output
