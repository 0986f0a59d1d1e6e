"""Torques of an MJCF agree with MuJoCo, with armatures, springs and gravity compensation."""

import numpy as np
import pytest

from stepbus_kinematics import RobotModel

mujoco = pytest.importorskip("mujoco")

ARM = """<mujoco><worldbody><body name="base">
<geom size=".1" mass="1"/>
<body name="upper" pos="0 .1 .2" euler="10 20 30" gravcomp=".6"><joint name="shoulder" axis="1 1 0"
  stiffness="20" springref="40" armature=".2" damping="2"/>
<geom type="box" size=".1 .2 .3" pos=".1 0 .2" mass="2"/>
<body name="lower" pos="0 .3 .1" gravcomp="1"><joint name="slide" type="slide" axis="0 1 1"
  ref=".2" armature="3"/><geom type="capsule" size=".05 .2" pos="0 .1 .1" mass="3"/>
<body name="hand" pos="0 0 .2" gravcomp="2"><geom type="box" size=".1 .1 .1" mass=".5"/>
</body></body></body></body></worldbody></mujoco>"""

HAND = """<mujoco><worldbody><body name="palm"><geom size=".1" mass="1"/>
<body name="left"><joint name="a" axis="1 0 0" pos="0 0 .1" ref="30" stiffness="3"/>
<joint name="b" axis="0 0 1" armature=".01"/><geom type="box" size=".1 .2 .3" pos="0 .2 0"/></body>
<body name="right" pos="1 0 0" gravcomp="1"><joint name="c" axis="0 1 0" stiffness="2"/>
<geom size=".1" pos="0 .2 0" mass=".3"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("text", [ARM, HAND], ids=["arm", "hand"])
def test_torques_and_masses_of_an_mjcf_are_those_of_mujoco(tmp_path, text):
    path = tmp_path / "robot.xml"
    path.write_text(text)
    robot, model = RobotModel(path), mujoco.MjModel.from_xml_string(text)
    data, zero = mujoco.MjData(model), np.zeros(model.nv)
    assert list(robot.joints) == [model.joint(n).name for n in range(model.njnt)]
    for q in np.random.default_rng(0).uniform(-1, 1, (20, model.nv)):
        data.qpos[:], data.qvel[:] = q, 0.0
        mujoco.mj_forward(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        gravity = robot.gravity_torque(q)
        columns = [robot.inverse_dynamics(q, zero, row) - gravity for row in np.eye(model.nv)]
        np.testing.assert_allclose(gravity, data.qfrc_bias - data.qfrc_passive, rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.transpose(columns), mass, rtol=0, atol=1e-9)
        data.qvel[:] = v = 3 * q[::-1]
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(
            robot.inverse_dynamics(q, v, zero),
            data.qfrc_bias - data.qfrc_passive,
            rtol=0,
            atol=1e-9,
        )
