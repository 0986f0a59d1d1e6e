#!/usr/bin/env bash
# A joint with much damping: MuJoCo's is implicit and stops it; PyBullet's is explicit, and above 2 I / dt throws the joint to its velocity limit.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6 pybullet==3.2.7
cat > "$folder/run.py" <<'PYTHON'
import sys
from pathlib import Path

import mujoco
import pybullet as p

STEP = 1 / 240
ROBOT = """<robot name="r"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="wrist"><inertial><mass value="0.1"/>
<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="wrist"/><axis xyz="0 0 1"/>
<limit effort="10" velocity="10"/><dynamics damping="{}"/></joint></robot>"""
p.connect(p.DIRECT)


def in_pybullet(path):
    """Return the velocity after 1 s that began with 1 rad/s, without gravity and motor [rad/s]."""
    p.resetSimulation()
    p.setTimeStep(STEP)
    body = p.loadURDF(path, useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0)
    p.changeDynamics(body, 0, linearDamping=0, angularDamping=0)
    p.resetJointState(body, 0, 0, 1.0)
    for _ in range(240):
        p.stepSimulation()
    return abs(p.getJointState(body, 0)[1])


def in_mujoco(path):
    """Return the same."""
    model = mujoco.MjModel.from_xml_path(path)
    model.opt.timestep = STEP
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    for _ in range(240):
        mujoco.mj_step(model, data)
    return abs(data.qvel[0])


with open(sys.argv[1], "w") as seen:
    for damping in (0.4, 0.6):
        path = f"{damping}.urdf"
        Path(path).write_text(ROBOT.format(damping))
        print(f"{damping}: {in_pybullet(path):.1f} {in_mujoco(path):.1f}", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7, mujoco 4.0.0: velocity of a wrist of 1e-3 kg m2 1 s after 1 rad/s, at 1/240 s,"
echo "with a damping below and above 2 I / dt = 0.48 N m s"
echo "guess: 0.0 0.0 for both"
echo "seen:"
cat seen
printf '0.4: 0.0 0.0\n0.6: 100.0 0.0\n' | cmp - seen
