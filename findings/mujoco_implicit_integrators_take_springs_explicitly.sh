#!/usr/bin/env bash
# MuJoCo: a joint spring above 4 I / dt2 diverges with every integrator, implicit ones too; damping is implicit with all of them but RK4.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6
cat > "$folder/run.py" <<'PYTHON'
import sys

import mujoco

MODEL = """<mujoco><option timestep="0.001" gravity="0 0 0" integrator="{}"/><worldbody><body>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint axis="0 0 1" {}/></body></worldbody></mujoco>"""


def verdict(integrator, joint):
    """Return "diverges" if a second of the simulation is found unstable, or "-"."""
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator, joint))
    data = mujoco.MjData(model)
    data.qpos[0] = 0.1
    data.qvel[0] = 1.0
    for _ in range(1000):
        mujoco.mj_step(model, data)
        if any(warning.number for warning in data.warning):
            return "diverges"
    return "-"


with open(sys.argv[1], "w") as seen:
    for integrator in ("Euler", "RK4", "implicit", "implicitfast"):
        joints = 'stiffness="9e6"', 'damping="5000"'
        print(f"{integrator}:", *(verdict(integrator, joint) for joint in joints), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "mujoco 4.0.0: a joint of 1 kg m2 at 1 ms with a spring of 9e6 N m, and with a damping of 5000 N m s"
echo "guess: Euler and RK4 diverge, implicit and implicitfast do not"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
Euler: diverges -
RK4: diverges diverges
implicit: diverges -
implicitfast: diverges -
SEEN
