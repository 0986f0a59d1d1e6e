#!/usr/bin/env bash
# PyBullet: a joint that one step takes more than 0.04 rad past its stop stays there, for ever.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.4.6
cat > "$folder/hinge.urdf" <<'URDF'
<robot name="hinge">
  <link name="base"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><mass value="1"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint" type="revolute"><parent link="base"/><child link="arm"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="100" velocity="100"/></joint>
</robot>
URDF
cat > "$folder/run.py" <<'PY'
import sys
from importlib.metadata import version

import pybullet as b


def ends(speed: float, **settings: int) -> list[float]:
    b.connect(b.DIRECT)
    b.setPhysicsEngineParameter(**settings)
    b.setTimeStep(0.005)
    body = b.loadURDF(sys.argv[1], useFixedBase=True, flags=b.URDF_USE_INERTIA_FROM_FILE)
    b.changeDynamics(body, 0, linearDamping=0, angularDamping=0, jointDamping=0)
    b.setJointMotorControl2(body, 0, b.VELOCITY_CONTROL, force=0)
    b.resetJointState(body, 0, 0.99, speed)
    places = []
    for _ in range(100):
        b.stepSimulation()
        places.append(b.getJointState(body, 0)[0])
    b.disconnect()
    return places


slow, fast = ends(5.0)[-1], ends(10.0)[-1]
joined = ends(10.0, useSplitImpulse=0)[-1]
print("pybullet", version("pybullet"))
print("guess: from 0.99 rad, at 5 or 10 rad/s, a hinge with stops at 1 rad is at most 1 rad at 0.5 s")
print(f"seen:  5 rad/s: {slow:.3f} rad; 10 rad/s: {fast:.3f} rad; with useSplitImpulse=0: {joined:.3f} rad")
sys.exit(0 if slow < 1.0 and joined < 1.0 and abs(fast - 1.04) < 1e-6 else 1)
PY
"$folder/venv/bin/python" "$folder/run.py" "$folder/hinge.urdf"
