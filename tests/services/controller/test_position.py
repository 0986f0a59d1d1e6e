"""The position controller: targets that arrive at the next one when the next command comes."""

from types import SimpleNamespace

import pytest
from support.services.control import make_config

from stepbus_controller.position_controller import PositionController
from stepbus_schemas import Description, InputConfig, JointReference, JointState, WiringError

STEP_NS = 50_000_000


def controller(*, every=1, delay=0, names=("b", "a"), **params):
    """Return a controller of joints a and b; the reference comes every so many steps."""
    inputs = {"state": "JointState/1", "reference": "JointReference/1"}
    outputs = {"command": "JointCommand/1", "status": "ControllerStatus/1"}
    given = {"joints": ["a", "b"], **params}
    config = make_config("controller", inputs, outputs, params=given, step_ns=STEP_NS)
    config.inputs["reference"] = InputConfig(
        source="mission", port="r", type="JointReference/1", every=every, delay=delay
    )
    made = PositionController(config)
    made.start({port: Description(names=list(names)) for port in inputs})
    return made


def commands(made, index=0):
    """Return what is published for a reference of b and a, in that order."""
    messages = {
        "state": JointState(position=[0.5, 0.25]),
        "reference": JointReference(
            position=[2.0, 1.0], velocity=[0.0, 1.0], acceleration=[0.0, 2.0]
        ),
    }
    return made.update(SimpleNamespace(index=index, get=lambda port, cls: messages[port]))


def test_targets_are_in_its_own_order_and_velocities_lead_to_the_next():
    said = commands(controller())
    assert said["command"].values == [1.0, 2.0]
    assert said["command"].velocity == pytest.approx([1.0 + 2.0 * 0.025, 0.0])
    assert said["status"].error == [0.75, 1.5]


def test_a_reference_that_is_held_moves_on_by_its_derivatives():
    said = commands(controller(every=4), index=6)
    assert said["command"].values == pytest.approx([1.0 + 0.1 + 0.1**2, 2.0])
    assert said["command"].velocity == pytest.approx([1.0 + 2.0 * 0.125, 0.0])


def test_a_delayed_reference_is_as_old_as_its_delay():
    assert commands(controller(delay=1), index=1)["command"].values[0] == pytest.approx(1.0525)


def test_feed_forward_may_be_left_out_and_effort_limited():
    said = commands(controller(feed_forward=False, effort_limit={"b": 2, "a": 1}))
    assert (said["command"].velocity, said["command"].effort_limit) == (None, [1.0, 2.0])


def test_a_missing_joint_is_named_for_both_inputs():
    with pytest.raises(WiringError) as caught:
        controller(names=("a", "c"))
    assert str(caught.value).count("has no joint 'b'") == 2


def test_a_prefix_names_one_of_two_robots_of_one_urdf():
    names = ["right/a", "right/b", "left/b", "left/a"]
    made = controller(names=names, prefix="left/", effort_limit={"a": 1, "b": 2})
    assert made.describe()["command"].names == ["left/a", "left/b"]
    with pytest.raises(WiringError, match="has no joint 'other/a'"):
        controller(names=names, prefix="other/")
