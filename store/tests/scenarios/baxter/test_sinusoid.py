"""The scenario `baxter`: two joints follow a sinusoid, the rest stands, and nothing is silent."""

import json
import runpy
from importlib import resources

import numpy as np
import pytest
from support.store_paths import SCENARIOS

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.run_scenario import Options, host_of, run
from stepbus_orchestrator.scenario.load import load
from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_tools.report.curves import JointCurves
from stepbus_tools.signals import read_tracking

WORLD = SCENARIOS / "baxter/world.yaml"
JOINTS = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
ARMS = [f"{side}_{joint}" for side in ("left", "right") for joint in JOINTS]


def run_baxter(folder, *overrides, in_process=True):
    return run(load("baxter", overrides), Options(out=folder, host=host_of(in_process=in_process)))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return run_baxter(tmp_path_factory.mktemp("baxter") / "run")


@pytest.fixture(scope="module")
def tracking(result):
    return read_tracking(Recording(result.recording))


def test_both_joints_follow_within_two_percent_and_five_milliseconds(result):
    assert result.exit_code == 0
    path = resources.files("stepbus_scenarios") / "two_link/metrics.py"
    found = runpy.run_path(str(path))["sinusoid"](Recording(result.recording))
    figures = ("amplitude.left_s0", "lag.left_s0", "amplitude.right_s0", "lag.right_s0")
    assert set(found) == set(figures)
    assert [found[name] for name in figures[::2]] == pytest.approx([1, 1], abs=0.02)
    assert [found[name] for name in figures[1::2]] == pytest.approx([0, 0], abs=0.005)


def test_no_other_joint_moves_more_than_half_a_degree(tracking):
    others = [joint for joint in ARMS if joint not in {"left_s0", "right_s0"}]
    moved = max(np.ptp(tracking.state_of(ARMS[0]).of("position", joint)) for joint in others)
    assert 0 < np.degrees(moved) < 0.5


def test_it_starts_without_a_jump(tracking):
    errors = np.abs([tracking.error(joint)[:20] for joint in ARMS])
    assert np.degrees(errors.max()) < 0.2


def test_targets_and_measurements_of_all_fourteen_are_recorded(tracking):
    assert list(tracking.state_of(ARMS[0]).names) == ARMS
    assert (
        tracking.state_of(ARMS[0]).fields["target"].shape
        == tracking.state_of(ARMS[0]).fields["position"].shape
    )
    assert tracking.state_of(ARMS[0]).fields["target"].shape == (201, 14)
    # Positions that are commanded are no torques to plot.
    curves = JointCurves()
    curves.take(tracking)
    assert curves.torques == []


def test_the_order_of_joints_of_one_participant_changes_nothing(tracking, tmp_path):
    backwards = f"[{', '.join(reversed(ARMS))}]"
    for name in ("plant", "controller"):
        result = run_baxter(tmp_path / name, f"{name}.params.joints={backwards}", "duration=2s")
        state = read_tracking(Recording(result.recording)).state_of(ARMS[0])
        for joint in ARMS:
            first = tracking.state_of(ARMS[0]).of("position", joint)[: len(state.t)]
            assert (state.of("position", joint) == first).all()


def test_it_is_the_same_to_the_byte_in_whatever_window_and_processes(tmp_path):
    narrow = ("duration=500ms", "window=1", "batch=1")
    first = run_baxter(tmp_path / "1", *narrow, in_process=False)
    second = run_baxter(tmp_path / "64", "duration=500ms")
    assert (first.exit_code, first.sha256) == (0, second.sha256)


def test_what_the_mission_begins_is_recorded_as_an_event(result):
    ((step, event),) = Recording(result.recording).messages("mission/events")
    assert (step, event.level, event.text.split(" of ")[0]) == (0, "info", "sine")


def test_nothing_touches_at_rest():
    plant = SimulatedPlant(load_world(WORLD), Params(world=WORLD.name), 50_000_000, 0)
    plant.physics.engine.update_shapes()
    assert plant.physics.engine.contacts() == []
    plant.close()


def test_describe_lists_the_motor_of_every_joint(capsys):
    off = "plant.params.effort.left_e0=0"
    assert main(["describe", "baxter", "--json", "--set", off]) == 0
    plant = json.loads(capsys.readouterr().out)[0]
    rows = plant["outputs"][0]["joints"]
    assert [row["name"] for row in rows] == ARMS
    assert [row["name"] for row in rows if not row["motor"]] == ["left_e0"]
    assert rows[1] == {
        "index": 1, "name": "left_s1", "type": "revolute", "mode": "position", "lower": -2.147,
        "upper": 1.047, "velocity": 1.5, "effort": 50.0, "motor": True,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("joints", "sentence"),
    [
        ("[left_s0, left_s0]", "participants.plant.params.joints: names 'left_s0' twice"),
        ("[left_so]", "params.joints: 'left_so' is unknown; did you mean 'left_s1'"),
    ],
)
def test_joints_there_twice_or_unknown_are_errors(joints, sentence, capsys, own_temp):
    assert main(["describe", "baxter", "--set", f"plant.params.joints={joints}"]) != 0
    assert sentence in capsys.readouterr().err


def test_a_warning_is_shown_counted_and_recorded(tmp_path, capsys):
    out = tmp_path / "run"
    orders = ["plant.params.effort.left_e0=0", "mission.params.offset.left_w0=90", "duration=500ms"]
    sets = [word for order in orders for word in ("--set", order)]
    assert main(["run", "baxter", "--in-process", "--out", str(out), "--no-report", *sets]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    effort = "step 0: joint left_e0: has an effort limit of 0 N·m; nothing moves it"
    degrees = "target 90 rad is beyond its stop"
    assert (shown.count(effort), shown.count(degrees)) == (2, 2)
    assert "warnings 2" in shown
    assert json.loads((out / "result.json").read_text())["warning_count"] == 2
    ((step, event),) = Recording(out / "run.mcap").messages("plant/events")
    assert (step, event.level, len(event.text.splitlines())) == (1, "warning", 2)
