"""Poses of links: the plant's truth is what Pinocchio makes of the measured angles."""

import numpy as np
import pinocchio as pin
import pytest
from support.services.plant import MS, TWO_LINK, write_world

from stepbus_plant import Params, SimulatedPlant, load_world

WORLD = """bodies:
  arm:
    {urdf: two_link.urdf, fixed_base: true, position: [1, 2, 3], joints: {joint1: {position: 0.5}}}
"""


@pytest.fixture
def plant(tmp_path):
    world = load_world(write_world(tmp_path, WORLD))
    plant = SimulatedPlant(world, Params(world="world.yaml"), 5 * MS, 0)
    yield plant
    plant.close()


def test_links_are_where_the_model_has_them(plant):
    model = pin.buildModelFromUrdf(str(TWO_LINK))
    data = model.createData()
    for _ in range(20):
        plant.advance()
    sensor = plant.pose_sensor(None)
    poses = sensor.sense()
    order = [plant.names.index(name) for name in list(model.names)[1:]]
    pin.framesForwardKinematics(model, data, np.array(plant.sense().position)[order])
    assert sensor.names == ["base", "link1", "link2"]
    for name, position, turn in zip(sensor.names, poses.position, poses.orientation, strict=True):
        wanted = data.oMf[model.getFrameId(name, pin.FrameType.BODY)]
        assert position == pytest.approx(wanted.translation + np.arange(1, 4), abs=1e-6)
        assert pin.Quaternion(np.array(turn)).matrix() == pytest.approx(wanted.rotation, abs=1e-6)


def test_links_come_in_the_order_that_is_asked_for(plant):
    every = plant.pose_sensor(None)
    turned = plant.pose_sensor(every.names[::-1])
    assert turned.sense().position == every.sense().position[::-1]
