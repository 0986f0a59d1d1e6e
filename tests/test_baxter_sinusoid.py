"""The scenario `baxter`: two joints follow a sinusoid, the rest stands, and nothing is silent."""

import json

import numpy as np
import pytest

from stepbus.config import package_path
from stepbus_orchestrator import Options, load, run
from stepbus_orchestrator.cli import main
from stepbus_orchestrator.reader import Recording
from stepbus_orchestrator.signals import read_tracking
from stepbus_orchestrator.sinusoid import fit_sinusoids, motion_at_rest, sinusoid_lines
from stepbus_schemas import WiringError

try:
    package_path("package://example-robot-data/robots")
except WiringError as exc:
    pytest.skip(str(exc), allow_module_level=True)

JOINTS = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
ARMS = [f"{side}_{joint}" for side in ("left", "right") for joint in JOINTS]


def run_baxter(folder, *overrides):
    return run(load("baxter", overrides), Options(out=folder))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return run_baxter(tmp_path_factory.mktemp("baxter") / "run")


@pytest.fixture(scope="module")
def tracking(result):
    return read_tracking(Recording.open(result.recording))


def test_both_joints_follow_within_two_percent_and_five_milliseconds(result, tracking):
    assert result.exit_code == 0
    fits = {fit.joint: fit for fit in fit_sinusoids(tracking, after_s=2.0)}
    assert {joint: round(np.degrees(fit.wanted), 6) for joint, fit in fits.items()} == {
        "left_s0": 10.0,
        "right_s0": 5.0,
    }
    assert max(abs(fit.excess) for fit in fits.values()) < 0.02
    assert max(abs(fit.lag_s) for fit in fits.values()) < 0.005


def test_no_other_joint_moves_more_than_half_a_degree(tracking):
    _, angle = motion_at_rest(tracking)
    assert 0 < np.degrees(angle) < 0.5


def test_it_starts_without_a_jump(tracking):
    errors = np.abs([tracking.error(joint)[:20] for joint in ARMS])
    assert np.degrees(errors.max()) < 0.2


def test_targets_and_measurements_of_all_fourteen_are_recorded(tracking):
    assert list(tracking.state.names) == ARMS
    assert tracking.state.fields["target"].shape == tracking.state.fields["position"].shape
    assert tracking.command.fields["values"].shape == (200, 14)


def test_the_summary_gives_amplitude_and_lag_in_degrees_and_milliseconds(tracking):
    lines = sinusoid_lines(tracking, after_s=2.0)
    assert [line.split(":")[0] for line in lines[:2]] == ["sinusoid  left_s0", "sinusoid  right_s0"]
    assert "° of 10.000° (" in lines[0]
    assert "lag " in lines[0]


def test_the_order_of_joints_of_one_participant_changes_nothing(tracking, tmp_path):
    backwards = f"[{', '.join(reversed(ARMS))}]"
    for name in ("plant", "controller"):
        result = run_baxter(tmp_path / name, f"{name}.params.joints={backwards}", "duration=2s")
        state = read_tracking(Recording.open(result.recording)).state
        for joint in ARMS:
            first = tracking.state.of("position", joint)[: len(state.t)]
            assert (state.of("position", joint) == first).all()


def test_a_warning_is_shown_counted_and_recorded(tmp_path, capsys):
    out = tmp_path / "run"
    orders = ["plant.params.effort.left_e0=0", "mission.params.offset.left_w0=90", "duration=500ms"]
    sets = [word for order in orders for word in ("--set", order)]
    assert main(["run", "baxter", "--out", str(out), "--no-report", *sets]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    effort = "step 0: joint left_e0: has an effort limit of 0 N·m; nothing moves it"
    degrees = "is it in degrees? 90° are 1.5708 rad"
    assert (shown.count(effort), shown.count(degrees)) == (2, 2)
    assert "warnings 2" in shown
    assert json.loads((out / "result.json").read_text())["warning_count"] == 2
    ((step, event),) = Recording.open(out / "run.mcap").messages("plant/events")
    assert (step, event.level, len(event.text.splitlines())) == (1, "warning", 2)
