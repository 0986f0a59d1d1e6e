"""A pick and place with a SCARA arm, over CoppeliaSim's ZeroMQ remote API.

10 cm above the cube, down, close, lift, check that the cube is really held, put it on its mark.
The script solves the arm's inverse kinematics itself, and sends a target for each joint at each
step, along motions with minimum jerk. Whatever goes wrong stops the simulation, with its cause.

    stepbus coppelia pick -- python examples/coppelia/systems/pick_and_place.py

Needs `pip install coppeliasim-zmqremoteapi-client`. Give another force [N] as the first argument.
"""

import math
import sys

from coppeliasim_zmqremoteapi_client import RemoteAPIClient

JOINTS = ("shoulder", "elbow", "lift", "wrist")
FASTEST = (3.0, 3.0, 0.5, 4.0)  # rad/s, rad/s, m/s, rad/s
NEAR, FAR, HEIGHT = 0.3, 0.25, 0.18  # lengths of the links, height of the tip at lift 0 [m]
GOAL = (0.3, 0.2, 0.0)  # x, y, yaw in the frame of the base [m, m, rad]
ABOVE, GRIP_HEIGHT, OPEN, EDGE = 0.1, 0.025, 0.04, 0.05  # m
FORCE = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0  # N

sim = RemoteAPIClient().require("sim")
arm = [sim.getObject(f"/arm/{name}") for name in JOINTS]
fingers = [sim.getObject(f"/arm/{side}_finger") for side in ("left", "right")]
base, tip, cube = (sim.getObject(path) for path in ("/arm", "/arm/grasp", "/cube_start_1"))
DT = sim.getSimulationTimeStep()


def reach(x, y, z, yaw, wrist):
    """Return the joint positions with the tip there; any quarter turn grips the cube."""
    cosine = (x * x + y * y - NEAR**2 - FAR**2) / (2 * NEAR * FAR)
    if abs(cosine) > 1:
        raise RuntimeError(f"{x:.3f}, {y:.3f} m is out of reach")
    elbow = math.acos(cosine)
    aside, along = FAR * math.sin(elbow), NEAR + FAR * math.cos(elbow)
    shoulder = math.remainder(math.atan2(y, x) - math.atan2(aside, along), math.tau)
    turn = math.remainder(yaw - shoulder - elbow - wrist, math.pi / 2)
    return [shoulder, elbow, z - HEIGHT, wrist + turn]


def wait(seconds):
    for _ in range(round(seconds / DT)):
        sim.step()


def move(end):
    """Move all joints to their ends, at 0.8 of their largest velocity."""
    start = [sim.getJointTargetPosition(joint) for joint in arm]
    ways = [b - a for a, b in zip(start, end, strict=True)]
    speeds = [1.875 * abs(way) / (0.8 * most) for way, most in zip(ways, FASTEST, strict=True)]
    steps = math.ceil(max(*speeds, 0.2) / DT)
    for k in range(1, steps + 1):
        u = k / steps
        share = ((6 * u - 15) * u + 10) * u**3
        for joint, a, way in zip(arm, start, ways, strict=True):
            sim.setJointTargetPosition(joint, a + way * share)
        sim.step()


def grip(velocity, is_done, what):
    """Drive both fingers until it is done, for 2 s at most."""
    for finger in fingers:
        sim.setJointTargetForce(finger, FORCE)
        sim.setJointTargetVelocity(finger, velocity)
    for _ in range(round(2 / DT)):
        sim.step()
        if is_done(sum(sim.getJointPosition(finger) for finger in fingers)):
            return
    raise RuntimeError(f"the gripper does not {what}")


def check_held():
    """Raise an error where the cube does not hang between the fingers."""
    offset = math.dist(sim.getObjectPosition(cube), sim.getObjectPosition(tip))
    width = sum(sim.getJointPosition(finger) for finger in fingers)
    if width < EDGE / 2 or offset > 2 * GRIP_HEIGHT:
        raise RuntimeError(f"the cube is not held: {width * 1e3:.1f} mm between the fingers")


def pick_and_place():
    x, y, z = sim.getObjectPosition(cube, base)
    yaw = sim.getObjectOrientation(cube, base)[2]
    at_cube = reach(x, y, z + GRIP_HEIGHT, yaw, 0.0)
    above_cube = [*at_cube[:2], at_cube[2] + ABOVE, at_cube[3]]
    at_goal = reach(*GOAL[:2], z + GRIP_HEIGHT, GOAL[2], at_cube[3])
    above_goal = [*at_goal[:2], at_goal[2] + ABOVE, at_goal[3]]
    move(above_cube)
    move(at_cube)
    grip(-0.1, lambda width: width < EDGE + 1e-3, "close on the cube")
    wait(0.1)
    move(above_cube)
    check_held()
    print(f"the cube is held, {sim.getSimulationTime():.2f} s")
    move(above_goal)
    check_held()
    move(at_goal)
    grip(0.1, lambda width: width > 2 * OPEN - 2e-3, "open")
    move(above_goal)
    wait(0.3)
    x, y, _ = sim.getObjectPosition(cube, base)
    off = math.dist((x, y), GOAL[:2])
    print(f"the cube stands {off * 1e3:.2f} mm from its goal, {sim.getSimulationTime():.2f} s")


sim.setStepping(True)
sim.startSimulation()
try:
    pick_and_place()
except RuntimeError as error:
    sys.exit(f"emergency stop: {error}")
finally:
    sim.stopSimulation()
