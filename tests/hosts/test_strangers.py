"""Who is not invited is refused, told, and changes no byte."""

import shutil
import subprocess
import sys

import pytest
from support.paths import PROGRAMS
from support.runs.distant import PATIENT, PORT, SHORT, Distant
from support.surroundings import comes_true

from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

pytestmark = [pytest.mark.usefixtures("nothing_is_left"), pytest.mark.slow]
STRANGER = 4


@pytest.fixture
def expected(tmp_path):
    return run(load("two_link", [*SHORT]), Options(out=tmp_path / "local")).messages_sha256


def outsider(network, what, *words):
    """Start a stranger on a host of its own; it waits until its input closes."""
    address = network.addresses[0], str(PORT)
    command = (sys.executable, PROGRAMS / "outsider.py", what, *address, *words)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    process = network.start(STRANGER, *command, **pipes)
    assert process.stdout.readline() == "ready\n"
    return process


def said_by(process):
    said, _ = process.communicate(timeout=100)
    return said.strip()


def visited(tmp_path, wan, what, *words):
    """Return a run of three hosts in whose midst a stranger acts, and what that says."""
    network = wan(5)
    network.shape(delay_s=0.010)
    distant = Distant(tmp_path, network, *SHORT, *PATIENT)
    assert comes_true(distant.ticket("mission").exists), distant.said()
    shutil.copy(distant.ticket("mission"), tmp_path / "copy.ticket")
    stranger = outsider(network, what, *words)
    distant.join().under_way(8_000)
    said = said_by(stranger)
    assert not distant.has_ended(), "the stranger was late"
    return distant, said


def assert_unchanged(distant, expected):
    result = distant.result()
    assert (result["exit_code"], result["messages_sha256"]) == (0, expected), distant.said()


@pytest.mark.parametrize("what", ["garbage", "no_certificate", "other_authority"])
def test_a_stranger_is_refused(tmp_path, wan, expected, what):
    distant, said = visited(tmp_path, wan, what)
    assert said.startswith("20 kept" if what == "garbage" else "refused"), said
    assert_unchanged(distant, expected)
    assert "refused a connection" in distant.terminal.read_text()


def test_a_participant_cannot_publish_as_another(tmp_path, wan, expected):
    distant, said = visited(tmp_path, wan, "other_key", tmp_path / "copy.ticket")
    assert said == "has published"
    assert_unchanged(distant, expected)
    text = distant.terminal.read_text()
    assert "refused a message on a key that its sender does not own" in text


def test_a_ticket_is_of_use_once(tmp_path, wan, expected):
    network = wan(5)
    network.shape(delay_s=0.020)
    distant = Distant(tmp_path, network, *SHORT, *PATIENT)
    distant.join().under_way(8_000)
    home = tmp_path / "second"
    shutil.copytree(tmp_path / "mission", home)
    shutil.copy(distant.ticket("mission"), home)
    distant.joined["second"] = home / "second.txt"
    words = "join", home / "mission.ticket"
    second = distant.start(STRANGER, *words, text=distant.joined["second"], cwd=home)
    assert second.wait(100) == 1, distant.said()
    assert_unchanged(distant, expected)
    assert "does another process use its ticket" in distant.joined["second"].read_text()
    assert f"refused {distant.wan.addresses[STRANGER]}: its ticket is in use" in distant.said()


def test_a_ticket_of_a_run_that_is_over_is_of_no_use(tmp_path, wan, expected):
    network = wan(5)
    first = Distant(tmp_path, network, *SHORT, hosts=("mission",))
    assert comes_true(first.ticket("mission").exists), first.said()
    shutil.copy(first.ticket("mission"), tmp_path / "old.ticket")
    assert_unchanged(first.join(), expected)
    (tmp_path / "second").mkdir()
    second = Distant(tmp_path / "second", network, *SHORT)
    assert comes_true(second.ticket("mission").exists), second.said()
    said = said_by(outsider(network, "old_ticket", tmp_path / "old.ticket"))
    assert said.startswith("refused: "), said
    assert_unchanged(second.join(), expected)
    assert "refused a connection" in second.terminal.read_text()
