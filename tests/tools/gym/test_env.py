"""Environments: their spaces, episodes, and what they leave of the process around them."""

import os
import signal
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import stepbus_gym
from stepbus_gym import StepbusEnv
from stepbus_orchestrator.errors import RunFailure
from stepbus_orchestrator.run.episode import Episode
from stepbus_orchestrator.scenario.load import load
from stepbus_participant import Participant
from stepbus_plant.engines import ENGINES, is_here
from stepbus_schemas import WiringError

PUSH = np.array([3.0, -2.0])


def nothing(_moment):
    return 0.0


@pytest.fixture
def make():
    made = []

    def make_one(scenario="two_link", **options):
        made.append(StepbusEnv(scenario, **{"reward": nothing, "duration": "100ms", **options}))
        return made[-1]

    yield make_one
    for env in made:
        env.close()


def episode(env, seed=None, action=PUSH):
    observation, info = env.reset(seed=seed)
    rows, over = [observation], False
    while not over:
        observation, _, terminated, truncated, info = env.step(action)
        rows.append(observation)
        over = terminated or truncated
    return np.array(rows), info


@pytest.mark.filterwarnings("ignore:.*Box (observation|action)")
def test_gymnasium_makes_it_and_its_checker_finds_nothing():
    assert stepbus_gym.TWO_LINK == "stepbus/two_link-v0"
    env = gymnasium.make("stepbus/two_link-v0", render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


def test_spaces_have_the_limits_names_and_units_of_the_ports(make):
    env = make()
    assert [field.name for field in env.action_fields] == [
        "command.values[joint1]",
        "command.values[joint2]",
    ]
    assert env.action_space.low.tolist() == [-50.0, -50.0]
    assert env.metadata["units"]["action"]["command.values[joint1]"] == "N·m"
    names = [field.name for field in env.observation_fields]
    assert names[:3] == [
        "joint_state.position[joint1]",
        "joint_state.position[joint2]",
        "joint_state.velocity[joint1]",
    ]
    assert len(names) == 12
    assert env.observation_fields[2].unit == "rad/s"
    assert (env.observation_fields[2].low, env.observation_fields[2].high) == (-20.0, 20.0)
    assert env.observation_space.shape == (12,)


def test_what_is_observed_and_done_can_be_chosen(make):
    env = make(
        observe=["reference.position", "joint_state.velocity"],
        joints=["joint2"],
        limits={"command.values": (-1.0, 1.0)},
    )
    assert [field.port for field in env.observation_fields] == ["reference"] * 2 + [
        "joint_state"
    ] * 2
    assert env.action_space.shape == (1,)
    assert (env.action_fields[0].entry, env.action_fields[0].high) == ("joint2", 1.0)
    assert make(mode="velocity").action_space.high.tolist() == [20.0, 20.0]
    assert make(mode="position").action_fields[0].unit == "rad"
    rows, info = episode(env, action=np.array([0.5]))
    assert info["step"] == 20
    assert len(rows) == 21


def test_an_episode_is_truncated_at_the_duration_and_the_same_for_the_same_seed(make):
    env = make()
    rows, info = episode(env, seed=7)
    assert (len(rows), info["step"], info["t"], info["recording"]) == (21, 20, 0.1, "")
    again, _ = episode(env, seed=7)
    assert np.array_equal(rows, again)
    assert env.result.seed == 7
    episode(env)
    drawn = env.result.seed
    episode(env, seed=7)
    episode(env)
    assert env.result.seed == drawn != 7


def test_environments_in_one_process_do_not_disturb_each_other(make):
    alone, _ = episode(make())
    one, two = make(), make()
    rows = [[env.reset()[0]] for env in (one, two)]
    for _ in range(20):
        rows[0].append(one.step(PUSH)[0])
        rows[1].append(two.step(PUSH)[0])
    assert np.array_equal(rows[0], alone)
    assert np.array_equal(rows[1], alone)


def test_between_two_steps_the_process_is_the_callers(make, tmp_path):
    env = make()
    observed = []

    def look():
        main = sys.modules["__main__"]
        observed.append((sys.path[:], sys.argv[:], sys.stdout, os._exit, main))
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)

    look()
    env.reset()
    look()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        env.step(PUSH)
        look()
        assert Path.cwd() == tmp_path
        env.close()
        assert Path.cwd() == tmp_path
    assert observed[0] == observed[1] == observed[2]


def test_every_nth_step_is_one_of_a_slow_policy(make):
    env = make(set={"controller.every": 4})
    env.reset()
    assert env.step(PUSH)[4]["step"] == 4
    assert episode(env)[1]["step"] == 20


def test_an_episode_begins_when_all_inputs_have_come(make):
    env = make(set={"controller.inputs.joint_state": {"from": "plant.joint_state", "delay": 3}})
    assert env.reset()[1]["step"] == 3


def test_settings_change_by_episode(make):
    drawn = []

    def vary(generator):
        drawn.append(float(generator.uniform(0.5, 1.5)))
        return {"mission.params.amplitude": drawn[-1]}

    env = make(vary=vary)
    observation, _ = env.reset(seed=1)
    first = observation[7]
    assert first == drawn[0]
    assert env.reset(seed=1)[0][7] == first
    assert env.reset()[0][7] != first
    assert env.reset(options={"set": {"mission.params.amplitude": 0.25}})[0][7] == 0.25


def test_a_reward_sees_the_moment_and_ends_the_episode(make):
    seen = []

    def reward(moment):
        seen.append(moment)
        return moment.inputs["joint_state"].position[0]

    env = make(reward=reward, terminated=lambda moment: moment.step == 5)
    env.reset()
    for _ in range(4):
        assert env.step(PUSH)[2:4] == (False, False)
    observation, value, terminated, truncated, info = env.step(2 * PUSH)
    assert (terminated, truncated, info["step"]) == (True, False, 5)
    assert value == observation[0] == seen[-1].observation[0]
    assert seen[-1].action.tolist() == [6.0, -4.0]
    assert env.result.reason == "the episode is terminated"
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset first"):
        env.step(PUSH)


def test_an_action_beyond_its_limits_is_clipped(make):
    rows, _ = episode(make(), action=np.array([1e6, -1e6]))
    at_limit, _ = episode(make(), action=np.array([50.0, -50.0]))
    assert np.array_equal(rows, at_limit)


@pytest.mark.parametrize("engine", ENGINES)
def test_pictures_show_the_simulation(make, engine):
    if not is_here(engine):
        pytest.skip(f"{engine} is not installed")
    camera = stepbus_gym.Camera(width=120, height=90)
    env = make(render_mode="rgb_array", camera=camera, set={"plant.params.engine": engine})
    env.reset()
    try:
        first = env.render()
    except WiringError as exc:
        pytest.skip(str(exc))
    assert (first.shape, first.dtype) == ((90, 120, 3), np.uint8)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 3
    # The white background is around the arm: nothing is cut off.
    rim = np.concatenate([first[0], first[-1], first[:, 0], first[:, -1]])
    assert (rim == 255).all()
    for _ in range(20):
        env.step(np.array([50.0, 50.0]))
    assert not np.array_equal(env.render(), first)
    assert make().render() is None


def test_ctrl_c_during_a_step_reaches_the_caller(tmp_path):
    class Interrupted(Participant):
        def __init__(self, config, answer):
            super().__init__(config)
            self.answer = answer

        def update(self, step):
            self.answer(step)
            signal.raise_signal(signal.SIGINT)
            return {}

    run = Episode(load("two_link"), "controller", Interrupted, tmp_path / "run", is_recorded=True)
    run.start()
    with pytest.raises(KeyboardInterrupt):
        run.advance(None)
    assert run.end("closed").outcome == "finished"


def test_an_environment_belongs_to_the_main_thread(make):
    env = make()
    env.reset()
    with ThreadPoolExecutor(1) as pool:
        with pytest.raises(WiringError, match="only in the thread that started it"):
            pool.submit(env.step, PUSH).result()
        with pytest.raises(WiringError, match="takes the main thread"):
            pool.submit(make().reset).result()
    assert env.step(PUSH)[4]["step"] == 1


def test_a_simulation_that_fails_says_why(make):
    env = make(mode="velocity")
    env.reset()
    with pytest.raises(RunFailure, match="joint1 has mode torque, but"):
        env.step(PUSH)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(PUSH)
    assert env.reset()[1]["step"] == 0


@pytest.mark.slow
def test_a_slow_caller_makes_nobody_late(make):
    env = make()
    env.reset()
    for _ in range(15):
        time.sleep(0.25)  # 3.75 s in sum, over the 3 s of each deadline
        env.step(PUSH)
    assert env.step(PUSH)[4]["step"] == 16
