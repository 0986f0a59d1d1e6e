"""What the error of a safe stop says about motion: as measured, not as wished."""

import pytest
from support.runs.kernel import MISSION, PLANT, scenario

from stepbus_orchestrator.run.safe_messages import motion_at_end
from stepbus_orchestrator.scenario.ports import OutputSpec
from stepbus_schemas import BaseState, Description, JointState, encode

PORTS = {"state": OutputSpec(type="JointState/1"), "base": OutputSpec(type="BaseState/1")}


def at_end(velocity, vx=0.0):
    plant = type(PLANT)(name="plant", exec=PLANT.exec, publishes="first", outputs=PORTS)
    described = {"plant": {"state": Description(names=["pan", "lift"]), "base": Description()}}
    state = JointState(position=[0.0, 0.0], velocity=velocity)
    newest = {
        "plant": {
            "state": encode(state),
            "base": encode(BaseState(x=0.0, y=0.0, yaw=0.0, vx=vx, wz=0.0)),
        }
    }
    return motion_at_end(scenario(plant, MISSION), described, newest)


@pytest.mark.parametrize(
    ("velocity", "vx", "text"),
    [
        ([0.0, 0.01], 0.001, "and the robot came to rest"),
        ([0.1, -0.5], 0.0, "but lift still moves at -0.500 rad/s or m/s"),
        ([0.0, 0.0], 0.5, "but the base (base) still moves at 0.500 m/s and 0.000 rad/s"),
    ],
)
def test_what_still_moves_is_named_with_its_speed(velocity, vx, text):
    assert at_end(velocity, vx) == text


def test_without_a_measured_velocity_rest_is_not_claimed():
    assert motion_at_end(scenario(PLANT, MISSION), {}, {}) == "and were commanded to stop"
