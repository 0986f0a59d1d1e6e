"""Recorded episodes: runs as any other, which a policy is tested with."""

import contextlib
from pathlib import Path

import numpy as np
import pytest

import stepbus
from stepbus_gym import StepbusEnv
from stepbus_gym.policy import load_policy

PROGRAMS = Path(__file__).parent / "programs"


def far(moment):
    return moment.step >= 30


def record(folder, **options):
    """Record two episodes: one that is terminated, one that is closed."""
    act = load_policy("track:act", [PROGRAMS])

    env = StepbusEnv("two_link", reward=lambda _: 0.0, record=folder, terminated=far, **options)
    paths = []
    for steps in (30, 12):
        observation, _ = env.reset()
        for _ in range(steps):
            observation, _, _, _, info = env.step(act(observation))
        paths.append(Path(info["recording"]))
    env.close()
    return paths


def test_each_episode_is_a_recording_of_what_it_did(tmp_path):
    paths = record(tmp_path / "episodes")
    assert [path.parent.name for path in paths] == ["000001", "000002"]
    for path, steps in zip(paths, (30, 12), strict=True):
        recording = stepbus.Recording(path)
        assert len(recording["controller.command"]) == steps
        assert len(recording["plant.joint_state"]) == steps + 1
    first, second = (np.array(stepbus.Recording(p)["controller.command"].values) for p in paths)
    assert np.array_equal(first[:12], second)


@pytest.mark.slow
@pytest.mark.usefixtures("starts_a_process")
def test_a_recorded_episode_is_a_test_of_its_policy(tmp_path):
    paths = record(tmp_path / "episodes")
    with contextlib.chdir(PROGRAMS):
        replay_all(paths)


def replay_all(paths):
    program = ["python", "-m", "stepbus_gym.policy"]
    for path in paths:
        assert stepbus.replay(path, "controller", program=[*program, "track:act"]).equal
    assert not stepbus.replay(paths[0], "controller", program=[*program, "track:other"]).equal
    with pytest.raises(stepbus.RunFailure, match="the recording names no policy; give one"):
        stepbus.replay(paths[0], "controller", program=program)
    with pytest.raises(stepbus.RunFailure, match="No module named 'nosuch'"):
        stepbus.replay(paths[0], "controller", program=[*program, "nosuch:act"])
