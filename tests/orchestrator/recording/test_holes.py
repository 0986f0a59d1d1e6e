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


@pytest.mark.parametrize("step", [0, 1, 30, 59])
def test_one_message_that_is_missing_is_found(two_link_recording, tmp_path, step):
    only = lacks(["controller/command"], [step])
    holes = Recording(rewrite(two_link_recording, tmp_path / "run.mcap", 4096, only)).holes()
    assert holes[-1] == CHAINS


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["recover", "{holed}", "--out", "{out}"], 0, f"hole: {CHAINS}"),
        (["replay", "{holed}", "--participant", "controller"], 8, f"has a hole: {CHAINS}"),
        (["diff", "{whole}", "{holed}"], 10, f"has a hole: {CHAINS}"),
        (["info", "{holed}"], 0, f"hole      {CHAINS}"),
    ],
)
def test_each_command_says_what_is_missing(
    holed, two_link_recording, tmp_path, capsys, words, code, said
):
    paths = {"holed": holed, "whole": two_link_recording, "out": tmp_path / "fixed.mcap"}
    assert main([word.format(**paths) for word in words]) == code
    output = "".join(capsys.readouterr())
    assert said in output
    assert "undamaged" not in output
