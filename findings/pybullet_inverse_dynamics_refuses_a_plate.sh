#!/usr/bin/env bash
# PyBullet: a plate (two moments add up to the third) can be simulated, but not asked for its mass matrix.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pybullet==3.2.7
cat > "$folder/arm.urdf" <<'XML'
<robot name="arm"><link name="base"/>
  <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
  <link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.2" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
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
p.stepSimulation()
print("a step", file=seen)
try:
    print(p.calculateMassMatrix(body, [0.0]), file=seen)
except (p.error, SystemError):
    print("an error", file=seen)
PYTHON
# PyBullet writes its own lines to both streams.
"$folder/venv/bin/python" "$folder/run.py" "$folder/arm.urdf" "$folder/seen" >/dev/null 2>&1
echo "pybullet 3.2.7"
echo "guess: a limit that is met exactly is met"
echo "seen:"
cat "$folder/seen"
printf 'a step\nan error\n' | cmp - "$folder/seen"
