"""The functions of CoppeliaSim, called in this process: paths, poses, joints, sensors, edits."""

import math
from pathlib import Path
from types import SimpleNamespace

import function_table
import numpy as np
import pytest
from stepbus_coppelia import overlay
from stepbus_coppelia.clients import ApiError, Client
from stepbus_coppelia.functions import CONSTANTS, GROUPS, NAMES
from stepbus_coppelia.functions.table import euler, matrix, of_euler, of_matrix, pose_of, turn_of
from stepbus_coppelia.gateway import open_session
from stepbus_coppelia.joints import groups_of
from stepbus_coppelia.params import Params

from stepbus import JointState

STEP_NS = 50_000_000
WORLD = """
physics_step: 5ms
bodies:
  rover:
    urdf: rover.urdf
    position: [0, 0, 0.1]
    joint_defaults: {mode: velocity}
    joints: {arm: {mode: torque}, lift: {mode: position}}
  box: {urdf: box.urdf, position: [2, 0, 0.5], fixed_base: true}
cameras: {eye: {link: body, width: 16, height: 8, near: 0.5, far: 10}}
"""
ROVER = """<robot name="rover"><link name="body">{inertia}<collision><geometry><box size=".4 .2 .1"/>
</geometry></collision></link>{joints}</robot>"""
JOINT = """<joint name="{name}" type="{type}"><parent link="{parent}"/><child link="{name}_link"/>
<origin xyz="{at}" rpy="0 0 0"/><axis xyz="{axis}"/><limit lower="-2" upper="2" effort="9"
velocity="0"/></joint><link name="{name}_link">{inertia}</link>"""
INERTIA = """<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0"
iyz="0"/></inertial>"""
BOX = f"""<robot name="box"><link name="box_link">{INERTIA}<visual><geometry><box size="1 1 1"/></geometry>
<material name="red"><color rgba="1 0 0 1"/></material></visual><collision><geometry>
<box size="1 1 1"/></geometry></collision></link></robot>"""
ROWS = [
    ("wheel", "continuous", "body", ".1 0 0", "0 1 0"),
    ("arm", "revolute", "body", "0 0 .2", "0 0 1"),
    ("lift", "prismatic", "arm_link", ".3 0 0", "1 0 0"),
]


@pytest.fixture
def folder(tmp_path):
    joints = "".join(
        JOINT.format(name=n, type=t, parent=p, at=at, axis=axis, inertia=INERTIA)
        for n, t, p, at, axis in ROWS
    )
    (tmp_path / "rover.urdf").write_text(ROVER.format(inertia=INERTIA, joints=joints))
    (tmp_path / "box.urdf").write_text(BOX)
    (tmp_path / "world.yaml").write_text(WORLD)
    return tmp_path


@pytest.fixture
def sim(folder):
    """Calls functions of a session that nobody is connected to."""
    params = Params.of(
        {
            "port": 0,
            "legacy_ports": [],
            "plant": {"world": "world.yaml"},
            "aliases": {"/Pioneer/motor[0]": "wheel", "left_motor": "wheel", "OldArm": "arm"},
            "collisions": {
                "Collision": ["/rover/arm/lift", "/box"],
                "Whole": ["/box", "/rover"],
                "Own": ["/rover", "/arm"],
                "Lost": ["/rover", "/box2"],
            },
            "proximity_sensors": {
                "front": {
                    "link": "body",
                    "position": [0.25, 0, 0.3],
                    "orientation_rpy": [0, math.pi / 2, 0],
                    "range": 3,
                }
            },
        },
        folder,
    )
    said = []
    session = open_session(params, STEP_NS, folder, ((), folder), say=said.append)
    physics = session.scene.physics
    session.scene.connect(
        groups_of(physics.joints, physics.bodies, 0.05), list(physics.joints), ["rover"]
    )
    client = Client("client 1")
    session.join(client)

    class Sim:
        state = session

        def __getattr__(self, name):
            def call(*args):
                results = session.call(client, name, list(args))
                return results[0] if len(results) == 1 else tuple(results) or None

            return call

    yield Sim()
    session.close()


# --- paths -----------------------------------------------------------------------------------------


def test_paths_find_anything_below(sim):
    arm = sim.getObject("/arm")
    assert sim.getObjectType(arm) == CONSTANTS["sceneobject_joint"]
    assert (
        sim.getObject("/rover/lift") == sim.getObject("/rover/arm/lift") == sim.getObject("/*/lift")
    )
    assert sim.getObject("./lift", {"proxy": arm}) == sim.getObject("/lift")
    assert sim.getObject("..", {"proxy": arm}) == sim.getObject("/rover")
    assert sim.getObject("/nothing", {"noError": True}) == -1
    assert sim.getObject("/arm{1}", {"noError": True}) == -1
    assert (
        sim.getObject("/arm[0]") == arm == sim.getObjectHandle("OldArm") == sim.getObject("/OldArm")
    )
    assert sim.getObjectHandle("nothing@silentError") == -1
    with pytest.raises(ApiError, match=r"in sim.getObject: .*; known: /rover, /rover/motor"):
        sim.getObject("/nothing")
    with pytest.raises(ApiError, match="did you mean '/rover/OldArm'"):
        sim.getObject("/Rover/oldarm")


def test_aliases_of_a_scenario_are_paths(sim):
    wheel = sim.getObject("/Pioneer/motor[0]")
    assert sim.getObjectAlias(wheel) == "motor"  # the first of its aliases
    assert sim.getObjectHandle("left_motor") == wheel == sim.getObject("/rover/motor")
    assert sim.getObjectAlias(wheel, 1) == "/rover/motor"


def test_siblings_of_one_alias_are_counted(sim):
    made = [sim.createDummy(0.1) for _ in range(3)]
    assert [sim.getObject("/Dummy", {"index": i}) for i in range(3)] == made
    assert sim.getObject("/Dummy[2]") == made[2] == sim.getObject("/Dummy{2}")
    sim.setObjectParent(made[1], made[0])
    assert sim.getObject("/Dummy[1]") == made[2]
    assert sim.getObject("/Dummy/Dummy") == made[1]
    assert sim.getObjectsInTree(made[0]) == made[:2]
    assert sim.getObjectsInTree(made[0], -2, 1) == [made[1]]
    sim.removeObjects(made)
    assert not sim.isHandle(made[0])


def test_a_parent_carries_what_is_below_it(sim):
    arm, low, high = sim.getObject("/arm"), sim.createDummy(0.1), sim.createDummy(0.1)
    sim.setObjectPosition(low, [1, 0, 0.3])
    sim.setObjectParent(low, arm)
    sim.setJointPosition(arm, math.pi / 2)
    assert sim.getObjectPosition(low) == pytest.approx([0, 1, 0.3], abs=1e-6)
    sim.setObjectPosition(low, [0, 2, 0.3])
    sim.setJointPosition(arm, 0)
    assert sim.getObjectPosition(low) == pytest.approx([2, 0, 0.3], abs=1e-6)
    # Where it does not keep its place, it keeps its pose in the frame of its parent.
    sim.setObjectPosition(high, [0.5, 0, 0])
    sim.setObjectParent(high, low, False)
    assert sim.getObjectPosition(high) == pytest.approx([2.5, 0, 0.3], abs=1e-6)
    sim.setObjectParent(high, -1, False)
    assert sim.getObjectPosition(high) == pytest.approx([0.5, 0, 0], abs=1e-6)
    sim.setObjectParent(high, low)
    for above in (low, high):
        with pytest.raises(ApiError, match="object is ancestor of desired parent"):
            sim.setObjectParent(low, above)


def test_handles_may_be_floats(sim):
    assert sim.getObjectAlias(float(sim.getObject("/arm"))) == "OldArm"


# --- poses -----------------------------------------------------------------------------------------


def test_angles_turn_about_x_then_y_then_z():
    a, b, c = 0.3, -0.7, 1.1
    x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    turn = of_euler([a, b, c])
    found = np.array(matrix(((0, 0, 0), turn))).reshape(3, 4)[:, :3]
    assert np.allclose(found, x @ y @ z, atol=1e-14)
    assert np.allclose(euler(turn), [a, b, c], atol=1e-14)


@pytest.mark.parametrize(
    "turn", [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0.6, 0.8, 0, 0), (1, 2, 3, 4), (0, 1, 0, 1)]
)
def test_matrices_are_read_back(turn):
    turn = turn_of([float(value) for value in turn])
    rows = matrix(((1.0, 2.0, 3.0), turn))
    assert np.allclose(matrix(of_matrix(rows)), rows, atol=1e-15)
    assert np.allclose(matrix(((1, 2, 3), of_euler(euler(turn)))), rows, atol=1e-9)


def test_poses_turn_about_an_axis(sim):
    pose = sim.rotateAroundAxis([1, 0, 0, 0, 0, 0, 1], [0, 0, 2], [0, 1, 5], math.pi / 2)
    assert pose == pytest.approx([1, 2, 0, 0, 0, math.sqrt(0.5), math.sqrt(0.5)])
    rows = matrix(pose_of(pose))
    rows = sim.rotateAroundAxis(rows, [0, 0, 2], [0, 1, 5], -math.pi / 2)
    assert rows == pytest.approx([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0], abs=1e-9)


def test_poses_are_in_any_frame_in_either_order(sim):
    box, rover, dummy = sim.getObject("/box"), sim.getObject("/rover"), sim.createDummy(0.1)
    sim.setObjectPosition(dummy, [1, 2, 3])
    assert sim.getObjectPosition(dummy, box) == pytest.approx([-1, 2, 2.5])
    sim.setObjectPosition(dummy, box, [0, 0, 1])  # as it was before version 4.3
    assert sim.getObjectPosition(dummy, -1) == pytest.approx([2, 0, 1.5])
    sim.setObjectParent(dummy, rover)
    sim.setObjectOrientation(rover, [0, 0, math.pi / 2])
    assert sim.getObjectPosition(dummy) == pytest.approx([0, 2, 1.5], abs=1e-6)
    assert sim.getObjectPosition(dummy, CONSTANTS["handle_parent"]) == pytest.approx([2, 0, 1.4])
    pose = sim.getObjectPose(rover)
    assert pose[3:] == pytest.approx([0, 0, math.sqrt(0.5), math.sqrt(0.5)])
    sim.setObjectMatrix(dummy, [1, 0, 0, 7, 0, 1, 0, 8, 0, 0, 1, 9])
    assert sim.getObjectMatrix(dummy) == pytest.approx([1, 0, 0, 7, 0, 1, 0, 8, 0, 0, 1, 9])
    with pytest.raises(ApiError, match="finite"):
        sim.setObjectPosition(dummy, [1, 2, math.nan])
    with pytest.raises(ApiError, match="only its joints move"):
        sim.setObjectPosition(sim.getObject("/arm_link"), [1, 2, 3])


def test_a_joint_has_a_frame_that_stays_and_one_that_moves(sim):
    arm, lift = sim.getObject("/arm"), sim.getObject("/lift")
    sim.setJointPosition(arm, math.pi / 2)
    assert sim.getObjectPosition(arm) == pytest.approx([0, 0, 0.3])
    assert sim.getObjectOrientation(arm) == pytest.approx([0, 0, 0], abs=1e-7)
    assert sim.getObjectPosition(lift) == pytest.approx([0, 0.3, 0.3], abs=1e-6)
    # In the frame of a joint, what it carries does not move.
    assert sim.getObjectPosition(lift, arm) == pytest.approx([0.3, 0, 0], abs=1e-6)
    sim.setJointPosition(lift, 0.5)
    assert sim.getObjectPosition(sim.getObject("/lift_link")) == pytest.approx(
        [0, 0.8, 0.3], abs=1e-6
    )
    assert sim.getObjectPosition(lift) == pytest.approx([0, 0.3, 0.3], abs=1e-6)


# --- joints ----------------------------------------------------------------------------------------


def commands(sim):
    return {
        port: (c.mode, c.values, c.effort_limit) for port, c in sim.state.scene.commands().items()
    }


def test_modes_become_commands_of_one_port_each(sim):
    assert commands(sim) == {}
    sim.setJointTargetVelocity(sim.getObject("/motor"), 3)
    sim.setJointTargetPosition(sim.getObject("/lift"), 0.5)
    assert commands(sim) == {
        "rover_velocity": ("velocity", [3.0], [9.0]),
        "rover_position": ("position", [0.5], [9.0]),
    }
    assert commands(sim) == {}
    sim.setJointTargetForce(sim.getObject("/arm"), -2.5)
    assert commands(sim) == {"rover_torque": ("torque", [-2.5], None)}


def test_a_huge_velocity_and_a_largest_force_are_a_torque(sim):
    arm, wheel = sim.getObject("/arm"), sim.getObject("/motor")
    sim.setJointMaxForce(arm, 4)
    sim.setJointTargetVelocity(arm, -9999)
    assert commands(sim)["rover_torque"] == ("torque", [-4.0], None)
    sim.setJointTargetVelocity(arm, 9999)
    assert commands(sim)["rover_torque"] == ("torque", [4.0], None)
    with pytest.raises(
        ApiError, match=r"mode torque .* cannot track 2 rad/s; give it mode velocity"
    ):
        sim.setJointTargetVelocity(arm, 2)
    sim.setObjectInt32Param(
        wheel, CONSTANTS["jointintparam_dynctrlmode"], CONSTANTS["jointdynctrl_force"]
    )
    sim.setJointTargetForce(wheel, -1.5)
    assert commands(sim)["rover_velocity"] == ("velocity", [-1e4], [1.5])


def test_a_velocity_joint_goes_to_positions_at_coppeliasims_gain(sim):
    wheel = sim.getObject("/motor")
    sim.setJointTargetPosition(wheel, 0.1)
    assert commands(sim)["rover_velocity"][1] == pytest.approx([2.0])
    sim.setJointTargetPosition(wheel, 100)
    assert commands(sim)["rover_velocity"][1] == pytest.approx([2 * math.pi])
    assert "rover_velocity" in commands(sim)  # it is another one at each step
    lift, velocity = sim.getObject("/lift"), CONSTANTS["jointdynctrl_velocity"]
    with pytest.raises(ApiError, match="joint lift has mode position in the world file"):
        sim.setObjectInt32Param(lift, CONSTANTS["jointintparam_dynctrlmode"], velocity)


def test_cyclic_joints_are_between_plus_and_minus_pi(sim):
    wheel = sim.getObject("/motor")
    sim.setJointPosition(wheel, 4.0)
    assert sim.getJointPosition(wheel) == pytest.approx(4.0 - 2 * math.pi)


def test_what_runs_is_restored_when_it_stops(sim):
    arm = sim.getObject("/arm")
    sim.setJointPosition(arm, 0.5)
    sim.setObjectPosition(sim.getObject("/rover"), [5, 0, 0.1])
    sim.startSimulation()
    assert sim.getSimulationState() == 16
    # What was changed before the simulation is its first change.
    first = sim.state.scene.changes.fields()
    assert (first["joints"], first["bodies"]) == (["arm"], ["rover"])
    # A change from now on is of this simulation only, also before its first step.
    sim.setJointPosition(arm, 1.0)
    state = JointState(position=[0.0, 1.5, 0.0], velocity=[0.0] * 3, effort=[0.0, 2.0, 0.0])
    sim.state.take(1, state, None)
    dummy = sim.createDummy(0.1)
    assert (sim.getJointPosition(arm), sim.getJointForce(arm)) == (1.5, -2.0)
    assert (sim.getSimulationTime(), sim.getSimulationState()) == (0.05, 17)
    sim.stopSimulation()
    assert sim.getJointPosition(arm) == 0.5
    assert sim.getObjectPosition(sim.getObject("/rover")) == pytest.approx([5, 0, 0.1])
    assert not sim.isHandle(dummy)


def test_a_step_that_is_asked_for_before_the_first_one_is_that(sim):
    sim.setStepping(True)
    sim.startSimulation()
    assert len(commands(sim)) == 3  # all, so that none has never been published
    sim.step()
    sim.state.take(0, None, None)
    assert sim.state.client.waits
    sim.state.take(1, None, None)
    assert not sim.state.client.waits
    assert sim.getInt32Signal("legacyRemoteApiStepCounter") == 1


def test_time_is_a_sum_as_in_coppeliasim(sim):
    sim.startSimulation()
    steps = 0
    while sim.getSimulationTime() < 5:
        steps += 1
        sim.state.take(steps, None, None)
    assert steps == 101


# --- sensors ---------------------------------------------------------------------------------------


def test_a_proximity_sensor_sees_along_its_axis(sim):
    front = sim.getObject("/front")
    found, distance, where, handle, normal = sim.readProximitySensor(front)
    assert (found, distance) == (1, pytest.approx(1.25, abs=1e-3))
    assert where == pytest.approx([0, 0, 1.25], abs=1e-3)
    assert handle == sim.getObject("/box")
    assert normal == pytest.approx([0, 0, -1], abs=1e-6)
    for other, finds in (("/box", 1), ("/rover", 0)):
        assert sim.checkProximitySensor(front, sim.getObject(other))[0] == finds
    assert sim.checkProximitySensor(front, CONSTANTS["handle_all"])[0] == 1
    sim.setObjectPosition(sim.getObject("/rover"), [10, 0, 0.1])
    assert sim.readProximitySensor(front) == (0, 0.0, [0, 0, 0], -1, [0, 0, 0])


def test_images_begin_at_the_bottom(sim):
    eye, rover = sim.getObject("/eye"), sim.getObject("/rover")
    # Its optical axis, z of the body, goes along x of the world, below the box.
    sim.setObjectPose(rover, [0, 0, -0.2, *turn_of([-0.5, 0.5, -0.5, 0.5])])
    data, size = sim.getVisionSensorImg(eye)
    assert size == sim.getVisionSensorRes(eye) == [16, 8]
    image = np.frombuffer(data, np.uint8).reshape(8, 16, 3)
    red = (image[..., 1] == 0).any(axis=1)
    assert red.any()
    assert not red.all()
    assert red[-1]  # the box is above the sensor, and the last row is the top
    grey, _ = sim.getVisionSensorImg(eye, 1)
    assert len(grey) == 16 * 8
    depth = np.frombuffer(sim.getVisionSensorDepth(eye, 1)[0], "<f4")
    assert depth.min() == pytest.approx(1.5, abs=0.01)


def test_a_script_may_give_a_sensor_its_image(sim):
    eye = sim.getObject("/eye")
    image = bytes(range(128)) * 3
    sim.setVisionSensorImg(eye, image)
    sim.startSimulation()
    assert sim.getVisionSensorImg(eye) == (image, [16, 8])
    sim.setVisionSensorImg(eye, bytes([9]) * 128, 1)
    assert sim.getVisionSensorCharImage(eye) == (bytes([9]) * 384, 16, 8)
    with pytest.raises(ApiError, match="bad arguments"):
        sim.setVisionSensorImg(eye, b"short")


def test_collisions(sim):
    rover, box, group = sim.getObject("/rover"), sim.getObject("/box"), sim.createCollection()
    sim.addItemToCollection(group, CONSTANTS["handle_single"], box)
    assert sim.checkCollision(rover, box) == (0, [-1, -1])
    sim.setObjectPosition(rover, [1.5, 0, 0.5])
    for other in (box, group, CONSTANTS["handle_all"]):
        assert sim.checkCollision(rover, other) == (1, [rover, box])


def test_collision_objects_are_of_the_scenario(sim):
    lift, whole = map(sim.getCollisionHandle, ("Collision", "Whole"))
    assert (sim.readCollision(lift), sim.readCollision(whole)) == (0, 0)
    sim.setObjectPosition(sim.getObject("/rover"), [1.5, 0, 0.5])
    assert (sim.readCollision(lift), sim.readCollision(whole)) == (0, 1)
    whys = {"Colision": "did you mean 'Collision'", "Lost": "'/box2' does not", "Own": "two bodies"}
    for name, why in whys.items():
        with pytest.raises(ApiError, match=why):
            sim.getCollisionHandle(name)
        assert why in sim.state.logged.pop()[1]
    for handle in (lift - 1, lift + 9, sim.getObject("/box")):
        with pytest.raises(ApiError, match="does not exist"):
            sim.readCollision(handle)


def test_names_of_old_do_what_new_ones_do(sim):
    box, mode = sim.getObject("/box"), CONSTANTS["shapeintparam_static"]
    assert (sim.getObjectName(box), sim.getObjectIntParameter(box, mode)) == ("box", 1)
    assert sim.getScriptHandle(1) == sim.getScript(1)
    assert sim.getShapeColor(box) == (1, [0.75] * 3)
    sim.setShapeColor(box, None, 0, [1, 0, 0.5])
    assert sim.getShapeColor(box, None, 0) == (1, [1.0, 0.0, 0.5])
    assert sim.getObjectChild(sim.getObject("/rover"), 1) == sim.getObject("/arm")
    assert sim.getObjectChild(CONSTANTS["handle_scene"], 1) == box
    assert (sim.getObjectChild(box, 0), sim.getObjectChild(box, -1)) == (-1, -1)
    with pytest.raises(ApiError, match="does not exist"):
        sim.getObjectChild(99, 0)


# --- what a script makes -------------------------------------------------------------------------


def test_shapes_are_made_before_the_simulation(sim):
    cube = sim.createPrimitiveShape(CONSTANTS["primitiveshape_cuboid"], [0.1, 0.2, 0.3])
    other = sim.createPureShape(1, 8, [0.2, 0.2, 0.2], 2.5)
    sim.setObjectPosition(cube, [0, 3, 1])
    assert sim.getObjectPosition(cube) == pytest.approx([0, 3, 1])
    assert sim.getObject("/Sphere") == other
    assert sim.getObjectAlias(cube) == "Cuboid"
    params = sim.state.scene.edits.params()["primitives"]
    assert "static" not in params["Cuboid"]  # it is, unless the script says otherwise
    assert params["Cuboid"]["mass"] == pytest.approx(500 * 0.006)
    assert (params["Sphere"]["static"], params["Sphere"]["mass"]) == (False, 2.5)
    sim.startSimulation()
    with pytest.raises(ApiError, match=r"before sim.startSimulation"):
        sim.createPrimitiveShape(CONSTANTS["primitiveshape_cuboid"], [0.1, 0.2, 0.3])
    sim.stopSimulation()
    sim.removeObject(cube)
    assert "Cuboid" not in sim.state.scene.edits.params()["primitives"]


def test_a_mass_that_is_set_while_it_runs_is_that_of_the_next_simulation(sim):
    box = sim.getObject("/box")
    sim.startSimulation()
    sim.setShapeMass(box, 2)
    assert sim.state.logged == [("warning", "/box has its new mass from the next simulation on")]
    assert not sim.state.scene.edits.is_new
    assert sim.state.scene.edits.params()["masses"] == {"box": 2.0}


def test_a_held_body_is_told_to_the_plant(sim):
    cube = sim.createPureShape(0, 8, [0.1, 0.1, 0.1], 1)
    sim.getObjectPosition(cube)
    sim.startSimulation()
    sim.setObjectParent(cube, sim.getObject("/arm_link"), True)
    fields = sim.state.scene.changes.fields()
    assert (fields["held"], fields["holders"]) == (["Cuboid"], ["arm_link"])


def test_files_of_coppeliasim_are_mapped_or_named(sim):
    with pytest.raises(ApiError, match=r"'robot.ttt' is a file of CoppeliaSim; map it to a world"):
        sim.loadScene("C:\\scenes\\robot.ttt")


def test_another_world_takes_the_place_of_the_first(sim, folder):
    (folder / "other.yaml").write_text("bodies: {box: {urdf: box.urdf, fixed_base: true}}\n")
    (folder / "bad.yaml").write_text("bodies: {box: {urdf: nothing.urdf}}\n")
    sim.state.params.scenes.update({"bad.ttt": "bad.yaml", "other.ttt": "other.yaml"})
    sim.state.params.models.update({"bad.ttm": "nothing.urdf", "box.ttm": "box.urdf"})
    sim.state.params.proximity_sensors.clear()
    arm, box = sim.getObject("/arm"), sim.getObject("/box")
    for call in (lambda: sim.loadScene("bad.ttt"), lambda: sim.loadModel("bad.ttm")):
        with pytest.raises(ApiError, match=r"nothing\.urdf"):
            call()
        # Nothing has changed.
        assert sim.getObjectPosition(box) == pytest.approx([2, 0, 0.5])
        assert sim.state.scene.edits.params() == {}
    model = sim.loadModel("/models/box.ttm")
    assert sim.getObjectAlias(model) == "box0"
    assert sim.loadScene("/a/other.ttt") == 1
    assert sim.getObjectPosition(box) == pytest.approx([0, 0, 0])
    assert [sim.isHandle(handle) for handle in (arm, box, model)] == [False, True, False]
    assert sim.getObject("/OldArm", {"noError": True}) == -1


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda sim: sim.createPureShape(0, 8, [0.1, 0.0, 0.1], 1), "sizes must be above 0 m"),
        (lambda sim: sim.createPureShape(0, 8, [0.1, 0.1, 0.1], -1), "mass must be above 0 kg"),
        (lambda sim: sim.setShapeMass(sim.getObject("/rover"), 2), "is a robot, whose masses"),
    ],
    ids=["size", "mass", "robot"],
)
def test_shapes_that_cannot_be_are_refused(sim, call, says):
    with pytest.raises(ApiError, match=says):
        call(sim)
    sim.startSimulation()


def test_unknown_functions_are_counted(sim):
    with pytest.raises(ApiError, match=r"in sim.simulateBananas: this function is not available"):
        sim.simulateBananas(1)
    assert sim.state.unanswered == {"simulateBananas": 1}


@pytest.mark.parametrize("args", [(), ("x",), (1, 2, 3, 4), (None,), ([1],), ({},), (10**30,)])
def test_bad_arguments_never_raise_anything_else(sim, args):
    for name in sorted(NAMES):
        try:
            sim.state.call(Client("other"), name, list(args))
        except ApiError as exc:
            assert str(exc).startswith(f"in sim.{name}: ")  # noqa: PT017


def test_every_function_is_described():
    for group in GROUPS:
        for name, work in group.names().items():
            assert (getattr(group, work).__doc__ or "").strip(), name
    assert len(NAMES) >= 100


def test_the_port_is_on_this_machine_only(sim):
    port = sim.state.endpoints[0].port
    path = Path("/proc/net/tcp").read_text()
    row = next(line for line in path.splitlines() if f":{port:04X} 00000000:0000" in line)
    assert "0100007F:" in row


def test_the_page_has_the_table_of_functions():
    page = function_table.PAGE.read_text()
    assert page == function_table.written(page), "run guests/coppelia/tests/function_table.py"


class Drawn:
    """Stands for viser's scene: keeps what is added."""

    def __init__(self):
        self.rows = []

    def add_point_cloud(self, name, points, colors, **more):
        self.rows.append(("points", name, points.tolist(), colors, more["point_size"]))

    def add_line_segments(self, name, points, colors, line_width):
        self.rows.append(("lines", name, points.tolist(), colors, line_width))


def test_what_a_script_draws_is_a_message_and_on_the_page(sim):
    line = sim.addDrawingObject(CONSTANTS["drawing_linestrip"], 2, 0, -1, 100, [0, 0.5, 1])
    dots = sim.addDrawingObject(CONSTANTS["drawing_spherepts"] | 4096, 0.1, 0, -1, 2)
    for x in (1, 2, 3):
        sim.addDrawingObjectItem(line, [x, 0, 0])
        sim.addDrawingObjectItem(dots, [0, x, 0])
    fields = sim.state.drawings.fields()
    assert fields["objects"] == ["strip 2.0 0.0 0.5 1.0 3 ", "points 0.1 0.0 0.0 0.0 2 "]
    assert sim.state.drawings.fields() == {}
    scene = Drawn()
    overlay.draw(scene, "/x", SimpleNamespace(**fields), {})
    ends = [[[1, 0, 0], [2, 0, 0]], [[2, 0, 0], [3, 0, 0]]]
    # Of cyclic objects, the oldest items go.
    assert scene.rows == [
        ("lines", "/x/0", ends, (0, 128, 255), 2.0),
        ("points", "/x/1", [[0, 2, 0], [0, 3, 0]], (0, 0, 0), 0.1),
    ]
    sim.addDrawingObjectItem(line, None)
    sim.removeDrawingObject(dots)
    assert sim.state.drawings.fields()["objects"] == ["strip 2.0 0.0 0.5 1.0 0 "]
