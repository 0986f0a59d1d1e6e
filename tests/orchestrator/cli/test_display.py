"""What reaches the terminal: where the display was opened, and as text, which forges no sentence."""

import io
import json
import subprocess
import sys

import pytest
from support.runs.joints import write_scenario

from stepbus_orchestrator.cli.terminal.live import displayed
from stepbus_orchestrator.cli.terminal.output import say_json, visible


@pytest.mark.parametrize("quiet", [False, True])
def test_a_sentence_goes_where_the_display_was_opened(monkeypatch, quiet):
    terminal, elsewhere = io.StringIO(), io.StringIO()
    stream = "stderr" if quiet else "stdout"
    monkeypatch.setattr(sys, stream, terminal)
    with displayed("test", quiet=quiet, invites=True) as display:
        # As a run in one process does while a participant has its turn.
        monkeypatch.setattr(sys, stream, elsewhere)
        display.event("warning", "plant", 3, "too warm")
    assert (terminal.getvalue(), elsewhere.getvalue()) == (
        "warning: plant at step 3: too warm\n",
        "",
    )


FORGED = "\\x1b[2J\\x1b[Hstepbus: two_link: finished\\nstepbus: all is well\\r\\x9b1m\\u202egnorw"
RAISES = f"""
from stepbus_participant import Participant
class Loud(Participant):
    def update(self, step):
        raise ValueError("{FORGED}")
"""
ENDS = RAISES.replace("raise ValueError(", "step.end(")


@pytest.mark.parametrize(("program", "code"), [(RAISES, 4), (ENDS, 0)])
@pytest.mark.parametrize("mode", [[], ["--in-process"]])
def test_a_text_of_a_participant_cannot_pass_for_one_of_ours(tmp_path, program, code, mode):
    scenario = write_scenario(tmp_path / "source")
    (scenario.parent / "loud.py").write_text(program)
    words = ["run", scenario, "--set", "mission.participant=loud.py:Loud", "--set", "duration=50ms"]
    command = [sys.executable, "-m", "stepbus_orchestrator.cli", *words, "--no-report", *mode]
    done = subprocess.run(
        [*command, "--out", tmp_path / "out"], capture_output=True, check=False, timeout=60
    )
    said = (done.stdout + done.stderr).decode()
    assert done.returncode == code
    assert "\\x1b[2J\\x1b[H" in said
    assert not {"\x1b", "\r", "\x9b", "\u202e"} & set(said)
    assert not [line for line in said.splitlines() if line.startswith("stepbus: all is well")]


def test_line_feeds_and_letters_of_all_languages_stay():
    assert visible("größer\n  日本語 ✓ 🤖") == "größer\n  日本語 ✓ 🤖"
    assert visible("a\tb\x08\x7f\x85\u2028") == "a\tb\\x08\\x7f\\x85\\u2028"


def test_json_stays_json(capsys):
    say_json({"text": "\x1b[2J\x9b\u202e"})
    printed = capsys.readouterr().out
    assert printed.isascii()
    assert json.loads(printed) == {"text": "\x1b[2J\x9b\u202e"}
