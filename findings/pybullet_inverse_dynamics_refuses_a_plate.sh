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
p.setTimeStep(1e-3)

def arm():
    body = p.loadURDF(sys.argv[1], useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0)
    for link in (-1, 0):
        p.changeDynamics(body, link, linearDamping=0, angularDamping=0)
    return body

body = arm()
p.stepSimulation()
print("seen a step")
try:
    print("seen", p.calculateMassMatrix(body, [0.0]))
except p.error:
    print("seen an error")
PYTHON
"$folder/venv/bin/python" "$folder/run.py" "$folder/arm.urdf" 2>/dev/null | grep '^seen' | tee "$folder/seen"
echo "pybullet 3.2.7"
echo "guess: a limit that is met exactly is met"
printf 'seen a step\nseen an error\n' | cmp - "$folder/seen"
