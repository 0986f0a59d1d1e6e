#!/usr/bin/env bash
# MuJoCo: solref="-1000 -50" is no spring of 1000 N/m: a ball of 1 kg sinks by 0.5 mm and one of 10 kg too, where PyBullet's contactStiffness=1000 gives 10 mm and 100 mm.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6 pybullet==3.2.7
cat > "$folder/run.py" <<'PYTHON'
import sys

import mujoco
import pybullet as p

MODEL = """<mujoco><option timestep="0.001" gravity="0 0 -10"/>
<default><geom solref="-1000 -50" solimp="0.95 0.95 0.001"/></default>
<worldbody><geom type="plane" size="1 1 .1"/>
<body pos="0 0 .1"><freejoint/><geom type="sphere" size=".1" mass="{}"/></body></worldbody></mujoco>"""
p.connect(p.DIRECT)


def in_pybullet(mass):
    """Return how deep a ball lies in a floor after 5 s [m]."""
    p.resetSimulation()
    p.setTimeStep(1e-3)
    p.setGravity(0, 0, -10)
    p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
    ball = p.createMultiBody(mass, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), -1, [0, 0, 0.1])
    p.changeDynamics(ball, -1, contactStiffness=1000, contactDamping=50)
    for _ in range(5000):
        p.stepSimulation()
    return 0.1 - p.getBasePositionAndOrientation(ball)[0][2]


def in_mujoco(mass):
    """Return the same."""
    model = mujoco.MjModel.from_xml_string(MODEL.format(mass))
    data = mujoco.MjData(model)
    for _ in range(5000):
        mujoco.mj_step(model, data)
    return 0.1 - data.qpos[2]


with open(sys.argv[1], "w") as seen:
    for mass in (1, 10):
        depths = (f"{1e3 * depth:.1f} mm" for depth in (in_pybullet(mass), in_mujoco(mass)))
        print(f"{mass} kg:", *depths, file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7, mujoco 4.0.0: how deep a ball sinks at 10 m/s2, with contactStiffness=1000 and with solref=\"-1000 -50\""
echo "guess: m g / k in both: 10 mm, and 100 mm with ten times the mass"
echo "seen:"
cat seen
printf '1 kg: 10.0 mm 0.5 mm\n10 kg: 100.0 mm 0.5 mm\n' | cmp - seen
