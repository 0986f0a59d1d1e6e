#!/usr/bin/env bash
# PyBullet reads <dynamics friction> of a joint and shows it, and the joint turns without any.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pybullet==3.2.7
cat > "$folder/arm.urdf" <<'XML'
<robot name="arm"><link name="base"/>
  <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><dynamics damping="0" friction="3"/></joint>
  <link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
XML
cat > "$folder/run.py" <<'PYTHON'
import sys
import pybullet as p

p.connect(p.DIRECT)
seen = open(sys.argv[2], "w")
p.setTimeStep(1e-3)

def arm():
    body = p.loadURDF(sys.argv[1], useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0)
    for link in (-1, 0):
        p.changeDynamics(body, link, linearDamping=0, angularDamping=0)
    return body

body = arm()
print("friction", p.getJointInfo(body, 0)[7], file=seen)
p.resetJointState(body, 0, 0.0, 1.0)
for _ in range(100):
    p.stepSimulation()
print("velocity after 0.1 s:", round(p.getJointState(body, 0)[1], 6), file=seen)
PYTHON
# PyBullet writes its own lines to both streams.
"$folder/venv/bin/python" "$folder/run.py" "$folder/arm.urdf" "$folder/seen" >/dev/null 2>&1
echo "pybullet 3.2.7"
echo "guess: 3 N m stop 0.7 kg m2 at 1 rad/s within 0.24 s: 0.57 rad/s are left after 0.1 s"
echo "seen:"
cat "$folder/seen"
printf 'friction 3.0\nvelocity after 0.1 s: 1.0\n' | cmp - "$folder/seen"
