"""`stepbus play` beside what the page of the docs shows: how it ends, what it waits for."""

import signal

import pytest
from support.runs.elsewhere import Elsewhere

from stepbus_orchestrator.cli import main, play
from stepbus_orchestrator.cli.commands import Play
from stepbus_orchestrator.errors import ExitCode


@pytest.fixture
def elsewhere():
    found = Elsewhere()
    yield found
    found.close()


@pytest.mark.usefixtures("nothing_is_left")
def test_who_holds_a_step_is_named_and_a_stop_compares_what_there_is(
    two_link_recording, tmp_path, elsewhere, monkeypatch, capsys
):
    process = elsewhere.join(tmp_path / "c.ticket")
    monkeypatch.setattr(play, "_PATIENCE_S", 0.3)

    class Stopping(play.Playing):
        def compared(self, step, lines):
            super().compared(step, lines)
            if step == 20:
                process.send_signal(signal.SIGSTOP)

        def event(self, level, who, step, text):
            super().event(level, who, step, text)
            if "not published" in text:
                pace.stop()
                process.send_signal(signal.SIGCONT)

    pace = play.Pace()
    monkeypatch.setattr(play, "Playing", Stopping)
    monkeypatch.setattr(play, "Pace", lambda: pace)
    options = {"participant": "controller", "rate": 100.0, "ticket": tmp_path / "c.ticket"}
    answer = play.play_command(Play.complete()(two_link_recording, **options))
    shown = "\n".join([capsys.readouterr().out, *answer.lines])
    assert "waiting: controller at step 2" in shown
    assert (answer.code, "stopped by the user" in shown) == (ExitCode.FINISHED, True), shown


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--from", "60"], "no step from 60 to 60: the recording has 60"),
        (["--from", "7ms"], "not a whole number"),
        (["--ticket", "taken"], "taken cannot be written: it exists"),
        (["--ticket", "taken/c"], "taken/c cannot be written: Not a directory"),
    ],
)
def test_what_cannot_be_played_is_one_sentence(
    two_link_recording, tmp_path, monkeypatch, capsys, options, text
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").touch()
    assert main(["play", str(two_link_recording), "--participant", "controller", *options]) != 0
    assert text in capsys.readouterr().err


@pytest.mark.usefixtures("nothing_is_left")
def test_a_stop_before_the_first_step_is_not_equal(
    two_link_recording, tmp_path, elsewhere, monkeypatch
):
    elsewhere.join(tmp_path / "c.ticket")
    pace = play.Pace(at=0)

    class Stopping(play.Playing):
        def progress(self, progress):
            super().progress(progress)
            if progress.phase == "paused":
                pace.stop()

    monkeypatch.setattr(play, "Playing", Stopping)
    monkeypatch.setattr(play, "Pace", lambda: pace)
    options = {"participant": "controller", "ticket": tmp_path / "c.ticket"}
    answer = play.play_command(Play.complete()(two_link_recording, **options))
    assert answer.code == ExitCode.INTERRUPTED
    assert answer.lines == ["stopped before controller made a step: nothing was compared"]


@pytest.mark.usefixtures("nothing_is_left")
def test_a_stop_ends_the_wait_for_who_has_not_joined(two_link_recording, tmp_path, monkeypatch):
    pace = play.Pace()
    pace.stop()
    monkeypatch.setattr(play, "Pace", lambda: pace)
    ticket = str(tmp_path / "c.ticket")
    given = ["play", str(two_link_recording), "--participant", "controller", "--ticket", ticket]
    assert main(given) == ExitCode.INTERRUPTED
