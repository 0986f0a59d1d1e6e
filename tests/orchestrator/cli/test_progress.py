"""How far a command is: a bar in a terminal, calm lines elsewhere."""

import io
import os
import re
import subprocess
from pathlib import Path

import pytest
from support.runs.terminal import STEPBUS, at_terminal

from stepbus_orchestrator.cli.terminal.live import Display, Reached
from stepbus_orchestrator.cli.terminal.output import ReadingLine
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.reports import Progress

CURSOR = re.compile(r"\x1b\[[\d;?]*[A-Zhl]")
"""What moves or hides the cursor, or removes a line."""
COLOR = re.compile(r"\x1b\[(?:\d+;)*(?:3[0-8]|9\d)[;\dm]")
RUN = ["run", "two_link", "--no-report", "--set"]


def progress(**given):
    defaults = {
        "phase": "stepping", "step": 0, "steps": 2000, "step_ns": 5_000_000, "elapsed_s": 0.0,
        "phases": {"plant": "stepping"}, "compute_us": {"plant": 80.0, "controller": 210.4},
        "drops": {"plant": 0}, "holders": (),
    }  # fmt: skip
    return Progress(**{**defaults, **given})


def printed(reports):
    """Return the times at which lines come, of reports (time, whether it is paused)."""
    now, lines = [0.0], []
    shown = Display(io.StringIO(), "arm", clock=lambda: now[0])
    shown.say = lambda line: lines.append((now[0], line))
    for time_s, is_paused in reports:
        now[0] = time_s
        what = "paused before step 3" if is_paused else "step 3"
        shown.show(Reached(what=what, is_paused=is_paused))
    return lines


def test_a_pipe_gets_a_line_after_2_10_and_50_seconds_and_then_each_minute():
    lines = printed([(tick / 4, False) for tick in range(4 * 200)])
    assert [time_s for time_s, _ in lines] == [2.0, 10.0, 50.0, 110.0, 170.0]


def test_what_ends_within_two_seconds_prints_nothing():
    assert printed([(tick / 4, False) for tick in range(8)]) == []


def test_a_pause_is_said_once_and_so_is_its_end():
    reports = [(time_s, 1 <= time_s < 500) for time_s in range(502)]
    lines = printed(reports)
    assert lines[0] == (1, "arm: paused before step 3")
    assert lines[1] == (500, "arm: step 3")
    assert len(lines) == 2


def test_a_run_says_its_share_its_rate_and_the_time_left():
    display = Display(io.StringIO(), "arm")
    display.reached(progress())
    reached = display.reached(progress(step=400, elapsed_s=1.0))
    assert reached.what == "step 400 of 2000, t = 2.00 s"
    assert reached.figures() == ["20 %", "2.0 × real time", "0:00:04 left"]
    assert reached.note == "slowest: controller, 210 µs a step"
    assert display.reached(progress(step=400, elapsed_s=2000.0)).left_s > 1000


@pytest.mark.slow
def test_a_terminal_shows_one_bar_and_nothing_of_it_stays(tmp_path):
    # In real time it lasts long enough for a rate on every machine.
    words = [*RUN, "duration=2500ms", "--real-time", "--out", tmp_path / "out"]
    code, shown = at_terminal(words)
    assert code == 0
    assert re.search(r"━.* \d+ %  [\d.]+ × real time  0:00:0\d left", shown)
    assert COLOR.search(shown)
    after = shown[shown.rindex("\x1b[2K") :]
    assert "finished after 500 steps" in after
    assert "━" not in after


@pytest.mark.parametrize(
    ("variables", "has_bar"), [({"NO_COLOR": "1"}, True), ({"TERM": "dumb"}, False)]
)
def test_a_terminal_without_colours_gets_none(tmp_path, variables, has_bar):
    code, shown = at_terminal([*RUN, "duration=50ms", "--out", tmp_path / "out"], **variables)
    assert code == 0
    assert not COLOR.search(shown)
    assert bool(CURSOR.search(shown)) == has_bar


@pytest.mark.parametrize("variables", [{}, {"FORCE_COLOR": "1"}])
def test_a_pipe_gets_lines_and_nothing_that_moves_a_cursor(tmp_path, variables):
    words = [*STEPBUS, *RUN, "duration=100ms"]
    environment = {**os.environ, "TERM": "xterm", **variables}
    done = subprocess.run(
        [*words, "--out", tmp_path / "out"], capture_output=True, text=True, env=environment,
        check=False, timeout=60,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert "finished after 20 steps" in done.stdout
    assert not CURSOR.search(done.stdout)


def test_a_long_recording_says_how_far_it_is_read_and_takes_the_line_back(capsys):
    now = [0.0]
    line = ReadingLine(lambda: now[0])
    for now[0], share in [
        (0, 0.0),
        (1.9, 0.1),
        (2.1, 0.2),
        (2.2, 0.3),
        (2.7, 0.4),
        (3.0, 1.0),
        (90, 0.1),
    ]:
        line(Path("runs/arm/run.mcap"), share)
    shown = capsys.readouterr().err.split("\r")
    assert [part.removesuffix("\x1b[K") for part in shown] == [
        "", "reading runs/arm/run.mcap: 20%", "reading runs/arm/run.mcap: 40%", "",
    ]  # fmt: skip


def test_whoever_reads_a_recording_tells_how_far(monkeypatch, two_link_recording):
    told = []
    monkeypatch.setattr(
        "stepbus_orchestrator.recording.source.watchers", [lambda *told_: told.append(told_)]
    )
    with Recording(two_link_recording) as recording:
        recording.holes()
        assert recording.counts["plant/joint_state"] == 61
    assert told[-1] == (recording.path, 1.0)
    assert sorted(told) == told
