"""The pick: a cube at a place that the seed draws is gripped, lifted and put down at a goal."""

import random
import runpy
from importlib import resources

import numpy as np
import pytest
from support.tools import needs_pybullet

from stepbus.testing import Bench, assert_replays, scenario_config
from stepbus_orchestrator.analysis.verify import verify
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.branch import branch
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load
from stepbus_scenarios.pick.mission import Pick
from stepbus_schemas import Description

SEEDS = range(5)
NEAR = 5e-3
CUBE = "cube_start_1"
INPUTS = ("joint_state", "gripper", "poses")


def picked(folder, *overrides):
    """Return the result of a run in this process."""
    return run(load("pick", overrides), Options(out=folder, host=InProcess()))


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pick")
    return [picked(folder / str(seed), f"seed={seed}") for seed in SEEDS]


@pytest.fixture(scope="module")
def recordings(results):
    return [Recording(result.recording) for result in results]


def poses(recording, link=CUBE):
    """Return the positions of a link over time, shape (T, 3) [m]."""
    port = recording["plant.poses"]
    return port.position[:, list(port.names).index(link)]


def placed(recording):
    """Return the metric of the scenario."""
    path = resources.files("stepbus_scenarios") / "pick/metrics.py"
    return runpy.run_path(str(path))["placed"](recording)


@pytest.mark.slow
def test_five_seeds_put_the_cube_within_5_mm_of_the_goal(results, recordings):
    assert [result.exit_code for result in results] == [0] * len(SEEDS)
    for recording in recordings:
        assert np.linalg.norm(poses(recording)[-1] - [0.3, 0.2, 0.4]) < NEAR


def test_the_cube_is_carried_by_the_gripper_and_touches_nothing_else(recordings):
    for recording in recordings:
        height = poses(recording)[:, 2] - 0.4
        assert height.max() == pytest.approx(0.1, abs=2e-3)
        holds = np.array([m.holding for _, m in recording["plant.gripper"].messages()])
        assert holds[height > 1e-3].all()


def test_each_seed_puts_the_cube_somewhere_else(recordings):
    starts = {tuple(poses(recording)[0].round(3)) for recording in recordings}
    assert len(starts) == len(SEEDS)


def test_the_same_seed_gives_the_same_recording(results, tmp_path):
    assert picked(tmp_path / "again", "seed=3").sha256 == results[3].sha256


def test_the_summary_is_what_the_metric_measures(results, recordings):
    for result, recording in zip(results, recordings, strict=True):
        _, event = recording["mission.summary"].latest(10**15)
        assert event.text in result.reason
        off = float(event.text.split(" mm")[0].rsplit(" ", 1)[1])
        assert off * 1e-3 == pytest.approx(placed(recording)["off"], abs=1e-5)


@needs_pybullet
def test_a_cube_that_is_too_slippery_is_lost_with_a_reason(tmp_path):
    # In MuJoCo the friction of a contact is that of the pads, the larger one.
    slippery = "plant.params.stock.friction=0.02", "plant.params.engine=pybullet"
    result = picked(tmp_path / "out", *slippery)
    assert result.exit_code == ExitCode.FAULT
    assert f"the gripper has lost {CUBE} (lift)" in result.reason
    assert placed(Recording(result.recording))["off"] > 0.1


def test_a_cube_that_is_taken_away_is_not_gripped(tmp_path):
    move = f"[{{at: 1s, body: {CUBE}, position: [0.1, 0.4, 0.4]}}]"
    result = picked(tmp_path / "out", f"plant.params.script={move}")
    assert f"{CUBE} is not gripped after 2 s: the fingers are 0.0 mm apart" in result.reason


def test_a_goal_out_of_reach_is_refused_at_the_first_step(tmp_path):
    result = picked(tmp_path / "out", "mission.params.goal=[0.9, 0, 0]")
    assert (result.exit_code, result.steps) == (ExitCode.FAULT, 0)
    assert "cannot reach the goal at 0.900, 0.000 m" in result.reason


@pytest.mark.slow
def test_the_mission_replays_from_the_recording(results):
    assert_replays(results[0].recording, "mission")


def test_a_mission_restored_at_any_stage_goes_on_as_if_it_had_not_been(recordings):
    recording = recordings[0]
    ports = {port: dict(recording[f"plant.{port}"].messages()) for port in INPUTS}
    names = {port: Description(names=recording[f"plant.{port}"].names) for port in INPUTS}
    config = scenario_config("pick", "mission")
    wanted = dict(recording["mission.command"].messages())
    bench = Bench(Pick, config, names)
    for step in sorted(wanted):
        if step % 50 == 0:
            saved, bench = bench.participant.save(), Bench(Pick, config, names)
            bench.participant.restore(saved)
        published = bench.step(step, **{port: ports[port][step] for port in INPUTS})
        assert published["command"] == wanted[step]
    assert bench.end_reason is not None


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_two_runs_in_processes_are_the_same(tmp_path):
    verification = verify(load("pick"), runs=2, out=tmp_path / "runs")
    assert verification.different is verification.failed is None
    assert len(verification.results) == 2


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_with_mujoco_branches_start_in_the_middle_of_the_grasp(tmp_path):
    pytest.importorskip("mujoco", reason="the engine MuJoCo is not installed")
    overrides = ("plant.params.engine=mujoco", "checkpoint=100ms")
    result = picked(tmp_path / "out", *overrides)
    assert placed(Recording(result.recording))["off"] < NEAR
    held = [
        step
        for step, state in Recording(result.recording)["plant.gripper"].messages()
        if state.holding
    ]
    # A branch never starts at a checkpoint of its own step.
    steps = random.Random("pick").sample(held[10:], 20)
    for step in steps:
        folder = tmp_path / str(step)
        repeated = branch(result.recording, folder, at=step, in_process=True)
        assert repeated.equal, step
        at = (step - 1) // 10 * 10
        assert repeated.restored == {"plant": at, "mission": at}, step
