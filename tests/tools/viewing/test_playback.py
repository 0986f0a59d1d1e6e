"""The page over a recording."""

import re

import numpy as np
import pytest
from support.browser import Curves, needs_chromium, opened

import stepbus
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_schemas import CallRecord
from stepbus_tools.viewing.history import History, stop_of
from stepbus_tools.viewing.playback import Playback, open_recording, run_names
from stepbus_tools.viewing.stage.recording_view import stop_banner


def record(folder, *overrides):
    scenario = load("two_link", ["duration=300ms", *overrides])
    return run(scenario, Options(out=folder, host=InProcess())).recording


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return record(tmp_path_factory.mktemp("playback") / "run")


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    return record(tmp_path_factory.mktemp("playback") / "other", "controller.params.kp=90")


def test_a_history_has_the_newest_message_of_a_time(recording):
    history = History(Recording(recording))
    assert (history.end_ns, history.last_step) == (300_000_000, 60)
    found = history.at(["plant/joint_state", "no/port"], 100_000_001)
    assert {topic: latest.step for topic, latest in found.items()} == {"plant/joint_state": 20}


def player(page, *paths):
    return Playback(page.server, *map(open_recording, paths))


def test_a_page_plays_to_its_end_and_stays_there(recording, page):
    playback = player(page, recording)
    playback.play(playing=True)
    for _ in range(5):
        playback.turn(0.1)
    assert "step 60 of 60" in playback.view.status.content
    assert not playback.is_playing


def test_the_divergence_from_a_second_recording_is_marked(recording, other, page):
    playback = player(page, recording, other)
    while not any("divergence" in event for event in playback.jumps):
        playback.turn(0.01)
    text = r"0\.005 s divergence: step 1: controller/command"
    assert re.match(text, next(iter(playback.jumps)))


def test_runs_are_named_by_as_much_of_their_folders_as_tells_them_apart(tmp_path):
    one, same = tmp_path / "a/run/run.mcap", tmp_path / "b/run/run.mcap"
    assert run_names([one, tmp_path / "pd/run.mcap"]) == ["run", "pd"]
    assert run_names([one, same]) == ["a/run", "b/run"]
    assert run_names([one, one]) == [str(one), str(one)]


def test_a_run_that_failed_ends_with_its_last_whole_step_and_says_so(tmp_path, page, monkeypatch):
    out = tmp_path / "run"
    result = stepbus.run("two_link", set={"duration": "1s"}, faults=["kill plant at 30"], out=out)
    history = History(Recording(result.recording))
    assert history.last_step == result.steps == 30
    assert history.end_ns == 30 * history.step_ns == 150_000_000
    html, add = [], page.server.gui.add_html
    monkeypatch.setattr(
        page.server.gui, "add_html", lambda text, **k: (html.append(text), add(text, **k))[1]
    )
    player(page, result.recording)
    assert "<b>failed</b>: step 30 (t = 0.150 s): plant was killed by SIGKILL" in html[0]


@pytest.mark.parametrize(
    ("args", "error", "stopped"),
    [
        ([True, "me"], None, "by me, since t = 2.50 s"),
        ([True], None, "by a call, since t = 2.50 s"),
        ([False, "me"], None, ""),
        ([True], "refused", None),
    ],
)
def test_a_call_stops_a_robot_or_releases_it(args, error, stopped):
    call = CallRecord(step=5, participant="plant", method="emergency_stop", args=args, error=error)
    assert stop_of(call, 2.5) == stopped
    assert (stop_banner(stopped or "") == "") == (not stopped)


def test_no_recording_and_an_empty_one_give_a_sentence(recording, tmp_path, capsys):
    foreign, cut = tmp_path / "foreign.mcap", tmp_path / "cut.mcap"
    foreign.write_text("no recording")
    cut.write_bytes(recording.read_bytes()[:3000])
    assert main(["view", str(foreign), "--no-open"]) != 0
    assert "is not an MCAP recording" in capsys.readouterr().err
    with pytest.raises(RecordingFailed, match="has no message that can be shown"):
        open_recording(cut)


def test_half_a_recording_is_shown_up_to_its_damage(recording, tmp_path, page):
    half, data = tmp_path / "half.mcap", recording.read_bytes()
    half.write_bytes(data[: len(data) * 3 // 4])
    playback = player(page, half)
    assert "the recording **is damaged: " in playback.view.status.content


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(900)
def test_the_buttons_of_the_page_do_what_they_say(recording, page):
    playback = Playback(page.server, Recording(recording))
    with opened(page.address, 640, 360) as watched:

        def shows(text):
            playback.turn(0.1)
            return watched.page.get_by_text(text).count() > 0

        watched.wait(lambda: shows("step 0 of 60"), "the page")
        watched.page.get_by_text("last »", exact=True).click()
        watched.wait(lambda: shows("step 60 of 60"), "the last step")
        watched.page.get_by_text("‹ back", exact=True).click()
        watched.wait(lambda: shows("step 59 of 60"), "the step before")
        watched.page.get_by_text("play", exact=True).click()
        watched.wait(lambda: shows("step 60 of 60"), "the end")
        watched.page.get_by_text("Curves", exact=True).click()
        curves = Curves(watched)
        watched.wait(lambda: curves.has("joint1", "joint2"), "the curves")
        assert curves.drawn().x == pytest.approx([0.0, 0.3])
        assert np.ptp(curves.drawn().data[1]) > 0.1
        watched.page.keyboard.press("Home")
        watched.wait(lambda: shows("step 0 of 60"), "the first step, from a tab")
        watched.page.keyboard.press(" ")
        watched.wait(lambda: shows("step 60 of 60"), "the end, played from a tab")
        watched.page.emulate_media(color_scheme="dark")
        dark = watched.page.locator(":root[data-mantine-color-scheme=dark]")
        watched.wait(lambda: dark.count() > 0, "the night")
        assert shows("step 60 of 60")
        watched.wait(curves.drawn, "the curves")
        watched.wait(lambda: watched.colours() > 300, "the arm to be drawn")
        bare = page.address.rsplit("/", 2)[0]
        assert watched.page.request.get(bare).status == 403
    assert not watched.errors
    assert not watched.strangers
