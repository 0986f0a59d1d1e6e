"""What an environment refuses: one sentence each."""

import numpy as np
import pytest

from stepbus_gym import StepbusEnv
from stepbus_schemas import StepbusError


def nothing(_moment):
    return 0.0


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"scenario": "two_lnik"}, "two_lnik"),
        ({"participant": "controler"}, "no participant 'controler'; did you mean 'controller'?"),
        ({"participant": "plant"}, "plant publishes first"),
        ({"participant": "mission", "act": ["referense"]}, "no port 'referense' among its outputs"),
        ({"participant": "mission"}, "its joints have no known names; give `joints`"),
        (
            {"act": ["command.valeus"]},
            "JointCommand/1 has no numeric field 'valeus'; did you mean 'values'?",
        ),
        ({"observe": ["joint_state.colour"]}, "JointState/1 has no numeric field 'colour'"),
        ({"joints": ["joint3"]}, "joint 'joint3' is unknown; did you mean 'joint2'?"),
        ({"mode": "tork"}, "'tork'; did you mean 'torque'"),
        ({"limits": {"comand.values": (-1, 1)}}, "an action; did you mean 'command.values'?"),
        (
            {"limits": {"reference.position": (-1, 1)}, "observe": ["joint_state"]},
            "limits: 'reference.position' is neither observed nor an action",
        ),
        (
            {"limits": {"command.values": (1, -1)}},
            "limits: 'command.values' must be (lowest, highest), not (1.0, -1.0)",
        ),
        (
            {"limits": {"command.values": 3}},
            "limits.command.values: must be a list of 2 values, not 3",
        ),
        (
            {"act": ["command.velocity"], "set": {"plant.params.world": "nosuch.yaml"}},
            "nosuch.yaml",
        ),
        ({"render_mode": "human"}, "only 'rgb_array' is supported"),
        ({"reward": 1.0}, "reward is not a function, but float"),
        ({"set": {"controller.params.kp": [1]}, "faults": ["kill plant at 3"]}, "kill plant at 3"),
        ({"set": {"plant.nonsense": 1}}, "nonsense"),
        ({"duration": "5"}, "duration"),
        ({"set": {"mission.exec": ["sh", "m.sh"]}}, "an environment runs in one process"),
    ],
)
def test_what_cannot_be_an_environment(options, sentence):
    given = {"scenario": "two_link", "reward": nothing, **options}
    with pytest.raises(StepbusError) as caught:
        StepbusEnv(**given)
    assert sentence in str(caught.value)
    assert "--in-process" not in str(caught.value)
    assert "its log" not in str(caught.value)


@pytest.fixture
def env():
    made = StepbusEnv("two_link", reward=nothing, duration="100ms")
    yield made
    made.close()


@pytest.mark.parametrize(
    ("action", "sentence"),
    [
        ([1.0], r"step 0: the action has shape \(1,\), not \(2,\)"),
        ([[1.0, 2.0]], r"shape \(1, 2\)"),
        ([1.0, np.nan], "step 0: entry 1 of the action is nan"),
        ([np.inf, 0.0], "entry 0 of the action is inf"),
        (["a", "b"], "not a vector of numbers"),
        (None, "the action"),
    ],
)
def test_an_action_of_another_form_costs_no_step(env, action, sentence):
    env.reset()
    with pytest.raises(StepbusError, match=sentence):
        env.step(action)
    assert env.step(np.zeros(2))[4]["step"] == 1


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        (None, "`reward` returned None, not a finite number"),
        (float("nan"), "`reward` returned nan"),
        ("much", "`reward` returned 'much'"),
        (ValueError("no data"), "`reward` raised ValueError: no data"),
    ],
)
def test_a_reward_that_is_none(value, sentence):
    def reward(_moment):
        if isinstance(value, Exception):
            raise value
        return value

    env = StepbusEnv("two_link", reward=reward, duration="100ms")
    env.reset()
    try:
        with pytest.raises(StepbusError, match=f"step 1: {sentence}"):
            env.step(np.zeros(2))
    finally:
        env.close()


def test_an_unknown_option_of_reset(env):
    with pytest.raises(StepbusError, match="option 'sett'; it has `set`"):
        env.reset(options={"sett": {}})
