"""The page of a run that is going."""

import json
import re
import signal
import subprocess
import sys
import threading

import psutil
import pytest
from support.browser import Curves, needs_chromium, opened
from support.messages.recordings import chunks
from support.paused import Paused
from support.surroundings import comes_true

import stepbus
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.rerun import Preparation
from stepbus_orchestrator.run.extensions.calls import recorded_calls
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.live_file import LIVE_FILE
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.viewing.live_page import follow

STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]


def test_who_watches_a_run_changes_nothing(tmp_path, page, plain, starts_a_process):
    before = set(threading.enumerate())
    paused, ended = Paused(tmp_path / "run", load("two_link", ["duration=1s"])), []
    viewer = threading.Thread(target=lambda: ended.append(follow(page.server, paused.out, bool)))
    viewer.start()
    # Let it go while it is watched.
    paused.pace.step(3)
    assert comes_true(
        lambda: any(one.name == "run client" for one in set(threading.enumerate()) - before)
    )
    result = paused.end()
    viewer.join()
    assert ended == [True]
    assert result.sha256 == plain


@pytest.mark.slow
def test_run_with_a_view_leaves_nothing_and_has_the_same_hash(tmp_path, plain):
    out = tmp_path / "run"
    command = [*STEPBUS, "run", "two_link", "--set", "duration=1s", "--view", "--no-open"]
    done = subprocess.run(
        [*command, "--out", out, "--json", "--no-report"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert re.search(r"view: http://127\.0\.0\.1:\d+/[\w-]{20,}/", done.stderr)
    assert json.loads(done.stdout)["sha256"] == plain
    assert not [
        p for p in psutil.process_iter(["cmdline"]) if str(out) in (p.info["cmdline"] or [])
    ]


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(900)
def test_the_buttons_act_on_the_run_and_a_rerun_does_it_again(tmp_path, page):
    paused = Paused(tmp_path / "run", load("two_link", ["duration=1s"]))
    over = threading.Event()
    viewer = threading.Thread(target=lambda: follow(page.server, paused.out, over.is_set))
    try:
        with opened(page.address, 640, 360) as watched:
            paused.pace.step(3)
            viewer.start()
            shown = watched.page
            watched.wait(lambda: shown.get_by_text("paused").count() > 0, "the pause")
            watched.wait(lambda: shown.get_by_text("step 3 of").count() > 0, "step 3")
            shown.get_by_role("button", name="step", exact=True).click()
            watched.wait(lambda: shown.get_by_text("step 4 of").count() > 0, "step 4")
            shown.get_by_role("tab", name="Curves").click()
            curves = Curves(watched)
            watched.wait(lambda: curves.has("joint1", "joint2"), "the positions")
            positions = curves.drawn().data
            assert positions[0][-2:] == pytest.approx([-0.005, 0.0])
            curves.pick("position [rad]", "effort [N·m]")
            watched.wait(lambda: curves.has("joint1", "joint2"), "the efforts")
            watched.wait(
                lambda: (now := curves.drawn()) and now.data[1:] != positions[1:], "the efforts"
            )
            shown.get_by_role("tab", name="Steer").click()
            slider = shown.get_by_role("slider").first
            watched.wait(lambda: slider.count() > 0, "a slider")
            slider.press("ArrowRight")
            shown.get_by_role("tab", name="Events").click()
            watched.wait(lambda: shown.get_by_text("mission set_target joint1").count() > 0, "it")
            watched.wait(lambda: watched.colours() > 200, "the arm to be drawn")
            shown.get_by_role("button", name="resume").click()
            watched.wait(lambda: not paused.thread.is_alive(), "the run to end")
        assert not watched.errors
        assert not watched.strangers
    finally:
        over.set()
        paused.interrupt.set()
        result = paused.end()
        viewer.join()
    assert [call.method for call in recorded_calls(Recording(result.recording))] == ["set_target"]
    assert Preparation(result.recording, tmp_path / "again").run().result.sha256 == result.sha256


@pytest.fixture
def said(page, monkeypatch):
    """All texts that are put on a page, as their handles."""
    gui, said = page.server.gui, []
    for name in ("add_html", "add_markdown"):
        add = getattr(gui, name)
        monkeypatch.setattr(
            gui, name, lambda *a, add=add, **k: (said.append(add(*a, **k)), said[-1])[1]
        )
    return said


def test_a_live_page_is_titled_by_the_scenario_and_says_when_it_ends(
    tmp_path, page, said, monkeypatch
):
    titles, out = [], tmp_path / "run"
    monkeypatch.setattr(page.server.gui, "set_panel_label", titles.append)
    run(load("two_link", ["duration=50ms"]), Options(out=out, host=InProcess()))
    assert follow(page.server, out, lambda: False)
    assert said[-1].content == (
        f"**This page is no longer live.** `stepbus view {out}` shows the recording."
    )
    assert (said[-1].visible, titles) == (True, ["two_link"])
    assert "**ended**" in [one.content for one in said]


def test_a_live_page_says_that_a_run_failed_and_why(tmp_path, page, said):
    out = tmp_path / "run"
    stepbus.run("two_link", set={"duration": "1s"}, faults=["kill plant at 30"], out=out)
    assert follow(page.server, out, lambda: False)
    told = [one.content for one in said]
    assert "**failed**" in told
    assert "**ended**" not in told
    assert (
        '<div class="failed" role="alert"><b>failed</b>: step 30 (t = 0.150 s): plant was killed '
        "by SIGKILL</div>"
    ) in told


def test_a_run_that_was_killed_is_no_longer_waited_for(tmp_path, page, plain_run, monkeypatch):
    monkeypatch.setattr("stepbus_tools.viewing.live_page._IDLE_S", 0.1)
    monkeypatch.setattr("stepbus_tools.viewing.live_page._RESULT_S", 0.1)
    killed = tmp_path / "run"
    killed.mkdir()
    (killed / LIVE_FILE).write_text("of a process that is no more")
    whole = plain_run.recording.read_bytes()
    (killed / "run.mcap").write_bytes(whole[: sum(chunks(whole)[0])])
    assert follow(page.server, killed, lambda: False)


@pytest.mark.slow
def test_viewers_that_are_killed_or_interrupted_leave_the_run_alone(tmp_path, plain):
    paused = Paused(tmp_path / "run", load("two_link", ["duration=1s"]))
    command = [*STEPBUS, "view", paused.out, "--follow", "--no-open"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as killed, subprocess.Popen(command, **pipes) as other:
        try:
            assert [viewer.stdout.readline()[:12] for viewer in (killed, other)] == 2 * [
                "view: http:/"
            ]
            paused.pace.step(3)
            killed.kill()
            paused.pace.step(3)
            other.send_signal(signal.SIGINT)
            assert (other.wait(), other.stderr.read()) == (0, "")
        finally:
            killed.kill()
            other.kill()
            result = paused.end()
    assert result.sha256 == plain
