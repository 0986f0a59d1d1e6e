#!/usr/bin/env bash
# PyBullet: after restoreState, a force-torque sensor and the torque of a motor read 0 until the next step,
# while positions, velocities and the forces of contacts are those of the state.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import pybullet

LINK = """<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>"""
with open("arm.urdf", "w") as file:
    file.write(f"""<robot name="arm">{LINK.format("base")}{LINK.format("arm")}
<joint name="lift" type="prismatic"><origin xyz="0.5 0.2 0.3"/><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="100" velocity="10"/></joint></robot>""")


def world():
    """Return an arm that its motor holds, beside a floor on which its base stands."""
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=client)
    pybullet.setGravity(0, 0, -9.81, physicsClientId=client)
    half = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[2, 2, 0.1], physicsClientId=client)
    pybullet.createMultiBody(0, half, basePosition=[0, 0, -0.2], physicsClientId=client)
    arm = pybullet.loadURDF("arm.urdf", physicsClientId=client)
    pybullet.enableJointForceTorqueSensor(arm, 0, True, client)
    return client, arm


def read(client, arm):
    position, velocity, reaction, torque = pybullet.getJointState(arm, 0, client)
    pressed = sum(row[9] for row in pybullet.getContactPoints(arm, physicsClientId=client))
    return round(position, 9), round(velocity, 9), round(reaction[3], 3), round(torque, 3), round(pressed, 3)


one, arm = world()
for _ in range(400):
    pybullet.stepSimulation(one)
pybullet.saveBullet("state.bullet", physicsClientId=one)
other, again = world()
pybullet.restoreState(fileName="state.bullet", physicsClientId=other)
before, after = read(one, arm), read(other, again)
print("position, velocity and contact forces equal:", (before[:2], before[4]) == (after[:2], after[4]))
print("reaction and motor torque of the saved world are 0:", [before[2] == 0, before[3] == 0])
print("reaction and motor torque of the restored one are 0:", [after[2] == 0, after[3] == 0])
pybullet.stepSimulation(one)
pybullet.stepSimulation(other)
print("all equal a step later:", read(one, arm) == read(other, again))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "pybullet 3.2.7: an arm on a floor, its motor holds it; saveBullet, restoreState in another client"
echo "guess: all readings are those of the state"
echo "seen:  what joints feel and motors apply is 0 until the next step"
cat > "$folder/expected" <<'END'
position, velocity and contact forces equal: True
reaction and motor torque of the saved world are 0: [False, False]
reaction and motor torque of the restored one are 0: [True, True]
all equal a step later: True
END
cmp "$folder/expected" "$folder/seen"
