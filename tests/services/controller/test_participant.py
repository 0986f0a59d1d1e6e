"""The controller as a participant: names, limits, held and absent inputs, messages."""

import numpy as np
import pytest
from support.services.control import JOINTS, controller_config, make_controller

from stepbus_controller.controller import Controller
from stepbus_schemas import JointReference, JointState, RunError, WiringError

PD = {"law": "pd", "kp": 100, "kd": 10, "model": "two_link.urdf"}
AT_ZERO = JointState(position=[0.0, 0.0], velocity=[0.0, 0.0])


def reference(*position: float) -> JointReference:
    zeros = [0.0] * len(position)
    return JointReference(position=list(position), velocity=zeros, acceleration=zeros)


def problems_of(**params: object) -> list[str]:
    with pytest.raises(WiringError) as caught:
        Controller(controller_config(**params))
    return str(caught.value).splitlines()


def test_nothing_is_commanded_before_both_inputs_are_there() -> None:
    controller = make_controller(controller_config(**PD))
    assert controller.update(0, joint_state=AT_ZERO) == {}
    assert controller.update(1, reference=reference(0.1, 0.2))["command"].values == [10.0, 20.0]


def test_a_held_reference_still_commands() -> None:
    controller = make_controller(controller_config(**PD))
    controller.update(0, joint_state=AT_ZERO, reference=reference(0.1, 0.2))
    state = JointState(position=[0.1, 0.0], velocity=[0.0, 0.0])
    assert controller.update(1, joint_state=state)["command"].values == [0.0, 20.0]


def test_torques_are_cut_at_the_effort_limit_and_said_to_be() -> None:
    controller = make_controller(controller_config(**PD))
    published = controller.update(0, joint_state=AT_ZERO, reference=reference(-0.9, 0.2))
    assert published["command"].values == [-50.0, 20.0]
    assert published["status"].saturated == [True, False]
    (warning,) = published["status"].warnings
    assert warning.startswith("joint1 saturates: -90.0 N·m")


def test_saturation_warns_once_per_spell() -> None:
    controller = make_controller(controller_config(**PD))
    controller.update(0, joint_state=AT_ZERO, reference=reference(0.9, 0.2))
    status = controller.update(1, joint_state=AT_ZERO)["status"]
    assert (status.saturated, status.warnings) == ([True, False], [])


@pytest.mark.parametrize("names", [["joint1", "joint2", "other"], ["other", "joint2", "joint1"]])
def test_joints_are_mapped_by_name(names: list[str]) -> None:
    controller = make_controller(controller_config(**PD), names)
    wanted = {"joint1": 0.1, "joint2": 0.2, "other": 9.0}
    state = JointState(position=[0.0] * 3, velocity=[0.0] * 3)
    published = controller.update(
        0, joint_state=state, reference=reference(*(wanted[name] for name in names))
    )
    assert published["command"].values == [10.0, 20.0]


def test_its_own_joint_order_is_that_of_params() -> None:
    controller = make_controller(controller_config(**PD, joints=["joint2", "joint1"]))
    published = controller.update(0, joint_state=AT_ZERO, reference=reference(0.1, 0.2))
    assert controller.participant.describe()["command"].names == ["joint2", "joint1"]
    assert published["command"].values == [20.0, 10.0]


def test_a_missing_joint_is_named_with_its_nearest() -> None:
    with pytest.raises(WiringError, match="'joint_state' has no joint"):
        make_controller(controller_config(**PD), ["joint1", "joint_2"])


def test_velocity_that_is_not_sensed_is_asked_for() -> None:
    controller = make_controller(controller_config(**PD))
    with pytest.raises(RunError, match=r"params\.velocity to finite_difference"):
        controller.update(0, joint_state=JointState(position=[0.0, 0.0]))


def test_a_vector_of_the_wrong_length_is_refused() -> None:
    controller = make_controller(controller_config(**PD))
    with pytest.raises(RunError, match="'reference': carries 1 position values"):
        controller.update(0, reference=reference(0.1))


def test_a_torque_that_is_no_number_is_refused() -> None:
    controller = make_controller(controller_config(**PD))
    state = JointState(position=[float("nan"), 0.0], velocity=[0.0, 0.0])
    with pytest.raises(RunError, match=r"step 7: the torques are \{'joint1': nan"):
        controller.update(7, joint_state=state, reference=reference(0.1, 0.2))


def test_finite_difference_counts_the_steps_between_two_samples() -> None:
    config = controller_config(
        every=4, law="pd", kp=0, kd=1, velocity="finite_difference", model="two_link.urdf"
    )
    controller = make_controller(config)
    controller.update(0, joint_state=AT_ZERO, reference=reference(0.0, 0.0))
    published = controller.update(4, joint_state=JointState(position=[0.02, -0.04]))
    np.testing.assert_allclose(published["command"].values, [-1.0, 2.0])


def test_a_held_joint_state_keeps_its_velocity() -> None:
    config = controller_config(
        law="pd", kp=0, kd=1, velocity="finite_difference", model="two_link.urdf"
    )
    controller = make_controller(config)
    controller.update(0, joint_state=AT_ZERO, reference=reference(0.0, 0.0))
    controller.update(1, joint_state=JointState(position=[0.005, 0.0]))
    np.testing.assert_allclose(controller.update(2)["command"].values, [-1.0, 0.0])


def test_every_mistake_in_the_params_is_listed() -> None:
    problems = problems_of(
        law="pd",
        model="two_link.urdf",
        kp=[1, 2, 3],
        kd={"joint1": 1, "jiont2": 2},
        kpp=3,
        effort_limit=-1,
        velocity="guessed",
        gravity=[0, 0, "down"],
    )
    keys = [row.split("params.")[1].split(":")[0] for row in problems]
    assert keys == ["gravity[2]", "effort_limit", "velocity", "kpp"]


def test_every_gain_that_does_not_fit_the_joints_of_the_model_is_listed() -> None:
    problems = problems_of(
        law="pd", model="two_link.urdf", kp=[1, 2, 3], kd={"joint1": 1, "jiont2": 2}
    )
    keys = [row.split("params.")[1].split(":")[0] for row in problems]
    assert keys == ["kp", "kd.jiont2", "kd"]


@pytest.mark.parametrize(
    ("params", "sentence"),
    [
        (
            {**PD, "model": None, "law": "computed_torque", "joints": JOINTS, "effort_limit": 50},
            "model: is missing; this law needs",
        ),
        ({**PD, "model": None}, "model: is missing"),
        ({**PD, "model": None, "joints": JOINTS}, "effort_limit: is missing"),
        ({**PD, "model": "world.yaml"}, "world.yaml:1: is not XML"),
        (
            {**PD, "joints": ["joint1", "joint3"]},
            "joint 'joint3' is not in two_link.urdf; did you mean 'joint2'",
        ),
        ({**PD, "law": "no_such_module:Law"}, "module 'no_such_module'"),
        ({**PD, "law": "pathlib:Law"}, "has no class 'Law'"),
        ({**PD, "law": "pathlib:Path"}, "class pathlib:Path needs a method 'torque'"),
        ({**PD, "velocity": "filtered"}, "cutoff_hz: is needed with velocity filtered"),
        ({**PD, "cutoff_hz": 50}, "cutoff_hz: is needed with velocity filtered, and only then"),
        ({**PD, "ki": 1}, "ki: applies only with law pid"),
    ],
)
def test_each_mistake_has_its_sentence(params: dict, sentence: str) -> None:
    with pytest.raises(WiringError, match=sentence):
        Controller(controller_config(**params))


def test_ports_that_do_not_fit_are_named() -> None:
    config = controller_config(**PD)
    del config.inputs["reference"]
    with pytest.raises(WiringError, match="port has type JointReference/1"):
        Controller(config)


def test_a_prefix_names_one_of_two_robots_of_one_urdf() -> None:
    names = ["right/joint1", "right/joint2", "left/joint1", "left/joint2"]
    config = controller_config(**{**PD, "kp": {"joint1": 100, "joint2": 50}}, prefix="left/")
    controller = make_controller(config, names)
    state = JointState(position=[0.0] * 4, velocity=[0.0] * 4)
    published = controller.update(0, joint_state=state, reference=reference(9, 9, 0.1, -2))
    assert controller.participant.describe()["command"].names == ["left/joint1", "left/joint2"]
    assert published["command"].values == [10.0, -50.0]
    assert published["status"].warnings[0].startswith("left/joint2 saturates")
