import math

import pytest
from support.services.devices import box, link, make_stand, write_gripper, write_urdf

from stepbus_plant.commander import CommandError
from stepbus_plant.engines import default_engine
from stepbus_schemas import GripperCommand, JointCommand

CAN = """
  can: {urdf: can.urdf, position: [0, 0, 0.0575], friction: {lateral: MU, spinning: 0.002}}
"""
WORLD = """
grippers:
  gripper: {left: left, right: right}
contacts:
  touch: {links: [left_pad, right_pad]}
bodies:
  ground: {urdf: ground.urdf, fixed_base: true}
  gripper:
    urdf: gripper.urdf
    position: [0, 0, 0.1575]
    fixed_base: true
    friction: {lateral: MU, spinning: 0.002}
    joint_defaults: {mode: velocity}
    joints:
      left: {position: 0.045}
      right: {position: 0.045}
"""
WIDTH_OF_CAN = 0.066


def make_gripper(folder, *, can=True, mu=0.8, boom=0.0, carton=None):
    write_gripper(folder, boom=boom)
    # PyBullet takes the product of both, MuJoCo the larger one.
    mu = mu if default_engine() == "pybullet" else mu * mu
    world = (WORLD + CAN if can else WORLD).replace("MU", str(mu))
    if carton is not None:
        world = world.replace("can.urdf", f"carton.urdf, orientation_rpy: [0, 0, {carton}]")
    inputs = {"gripper": "GripperCommand/1", "lift": "JointCommand/1"}
    names = {"lift": ["lift"]}
    if boom:
        inputs |= {"swing": "JointCommand/1"}
        names |= {"swing": ["swing"]}
    outputs = {
        "gripper": "GripperState/1",
        "touch": "Contacts/1",
        "truth": "Poses/1",
        "warnings": "Event/1",
    }
    return make_stand(folder, world, outputs, inputs, **names)


def run(stand, steps, **commands):
    """Return what is shown after some steps under the same commands."""
    for step in range(steps):
        stand.update(step, **(commands if step == 0 else {}))
    return stand.participant.output(None)


def height_of(stand, shown):
    names = stand.participant.describe()["truth"].names
    return shown["truth"].position[names.index("can")][2]


def lift(stand):
    """Return what is shown once the slide has gone up by 0.1 m."""
    run(stand, 200, lift=JointCommand(mode="velocity", values=[0.1]))
    return run(stand, 40, lift=JointCommand(mode="velocity", values=[0.0]))


def test_a_can_is_gripped_with_15_newtons_and_lifted(tmp_path):
    stand = make_gripper(tmp_path)
    gripped = run(stand, 100, gripper=GripperCommand(width=0.0, force=15.0))["gripper"]
    assert gripped.holding
    # PyBullet keeps shapes about 1 mm apart.
    assert gripped.width == pytest.approx(WIDTH_OF_CAN, abs=2.5e-3)
    lifted = lift(stand)
    assert lifted["gripper"].holding
    assert lifted["gripper"].force == pytest.approx(15.0, abs=0.1)
    assert height_of(stand, lifted) == pytest.approx(0.1575, abs=2e-3)


def test_both_fingers_together_press_twice_the_force_on_a_can_that_stands(tmp_path):
    shown = run(make_gripper(tmp_path), 100, gripper=GripperCommand(width=0.0, force=15.0))
    pairs = [("can", "left_pad"), ("can", "right_pad")]
    assert [pair for pair in shown["touch"].pairs if "can" in pair] == pairs
    force = dict(zip(shown["touch"].pairs, shown["touch"].force, strict=True))
    assert force[pairs[0]] + force[pairs[1]] == pytest.approx(30.0, abs=0.3)
    # The ground holds the can while the fingers still centre it: they press unequally.
    assert shown["gripper"].force == min(force[pair] for pair in pairs)
    assert 13.0 < shown["gripper"].force < 15.0


def swing(stand, seconds=5.0):
    """Swing the gripper to and fro by 1 rad, at up to 3 rad/s² and 1.5 rad/s; return what shows."""
    for k in range(int(seconds / 0.005)):
        v = 1.5 * math.sin(2.0 * k * 0.005)
        stand.update(k, swing=JointCommand(mode="velocity", values=[v]))
    return stand.participant.output(None)


def shift_on_pads(stand, shown):
    """Return how far the can has gone from the middle of the pads, across their width [m]."""
    names = stand.participant.describe()["truth"].names
    can, left, right = (
        shown["truth"].position[names.index(n)] for n in ("can", "left_pad", "right_pad")
    )
    along = [b - a for a, b in zip(left, right, strict=True)]
    off = [c - (a + b) / 2 for a, b, c in zip(left, right, can, strict=True)]
    return (off[0] * along[1] - off[1] * along[0]) / math.hypot(*along)


def test_what_is_held_does_not_creep_while_the_arm_swings(tmp_path):
    stand = make_gripper(tmp_path, boom=0.6)
    run(stand, 100, gripper=GripperCommand(width=0.0, force=15.0))
    lifted = lift(stand)
    swung = swing(stand)
    # MuJoCo's friction is soft.
    off = 2e-4 if default_engine() == "pybullet" else 2e-3
    assert shift_on_pads(stand, swung) == pytest.approx(shift_on_pads(stand, lifted), abs=off)
    assert swung["gripper"].slip < off


def test_slip_is_how_far_the_can_has_slid_down_between_the_pads(tmp_path):
    stand = make_gripper(tmp_path, mu=0.5)
    run(stand, 100, gripper=GripperCommand(width=0.0, force=8.0))
    before = run(stand, 1)
    lifted = lift(stand)
    assert before["gripper"].slip < (1e-4 if default_engine() == "pybullet" else 2e-4)
    assert lifted["gripper"].holding
    below = 0.1 + height_of(stand, before) - height_of(stand, lifted)
    assert lifted["gripper"].slip == pytest.approx(below, abs=2e-4)
    assert below > 2e-3


def test_slip_starts_anew_with_each_grip(tmp_path):
    stand = make_gripper(tmp_path, mu=0.5)
    run(stand, 100, gripper=GripperCommand(width=0.0, force=8.0))
    lift(stand)
    assert run(stand, 100, gripper=GripperCommand(width=0.09, force=15.0))["gripper"].slip == 0.0


def test_a_slippery_can_stays_where_it_is(tmp_path):
    stand = make_gripper(tmp_path, mu=0.3)
    run(stand, 100, gripper=GripperCommand(width=0.0, force=15.0))
    lifted = lift(stand)
    assert height_of(stand, lifted) < 0.07
    assert not lifted["gripper"].holding


def test_an_empty_gripper_closes_to_its_width_and_holds_nothing(tmp_path):
    stand = make_gripper(tmp_path, can=False)
    gripper = run(stand, 300, gripper=GripperCommand(width=0.02, force=15.0))["gripper"]
    assert (gripper.force, gripper.holding) == (0.0, False)
    assert gripper.width == pytest.approx(0.02, abs=1e-4)


def test_the_fingers_stay_coupled_when_a_can_is_off_centre(tmp_path):
    stand = make_gripper(tmp_path)
    run(stand, 100, gripper=GripperCommand(width=0.0, force=15.0))
    shown = stand.participant.plant.sense()
    fingers = dict(zip(stand.participant.plant.names, shown.position, strict=True))
    assert fingers["left"] == pytest.approx(fingers["right"], abs=5e-4)


def test_pads_that_rest_on_the_ground_hold_nothing(tmp_path):
    write_gripper(tmp_path)
    # It stands on its two pads, as on feet.
    standing = WORLD.replace("0.1575", "0.115").replace("MU", "0.8")
    standing = standing.replace("    fixed_base: true\n", "")
    stand = make_stand(tmp_path, standing, {"gripper": "GripperState/1"}, {})
    gripper = run(stand, 10)["gripper"]
    assert gripper.force > 5.0
    assert not gripper.holding


@pytest.mark.parametrize(("width", "force"), [(math.nan, 1.0), (0.0, math.nan)])
def test_a_command_that_is_not_finite_is_refused(tmp_path, width, force):
    with pytest.raises(CommandError, match=r"input 'gripper': .* of joint left is nan"):
        make_gripper(tmp_path).update(0, gripper=GripperCommand(width=width, force=force))


@pytest.mark.parametrize("force", [0.0, -1.0])
def test_a_gripper_without_force_is_told(tmp_path, force):
    shown = run(make_gripper(tmp_path), 1, gripper=GripperCommand(width=0.0, force=force))
    assert "left: has an effort limit of 0 " in shown["warnings"].text


@pytest.mark.parametrize("yaw", [0.0, 0.01, 0.05])
def test_a_carton_is_held_while_the_gripper_turns(tmp_path, yaw):
    """The engine kept the normals of the pads' contacts, and pressed along them."""
    write_urdf(tmp_path, "carton", link("can", 0.4, box("0.06 0.06 0.115")))
    stand = make_gripper(tmp_path, boom=0.5, carton=yaw)
    run(stand, 100, gripper=GripperCommand(width=0.0, force=15.0))
    lift(stand)
    held = []
    for step in range(500):
        turn = JointCommand(mode="velocity", values=[0.6])
        stand.update(step, **({"swing": turn} if step == 0 else {}))
        held.append(stand.participant.output(None)["gripper"])
    assert all(state.holding for state in held)
    assert max(state.slip for state in held) < 2e-3
