#!/usr/bin/env bash
# Height fields: of the same rows, PyBullet puts the first at -y and the middle height at z = 0, MuJoCo's elevation the first at +y and the lowest at 0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6 pybullet==3.2.7
cat > "$folder/run.py" <<'PYTHON'
import sys

import mujoco
import numpy as np
import pybullet as p

ROWS, AT = [0, 0, 0, 1, 1, 1, 4, 4, 4], (-0.9, -1e-3, 0.9)
p.connect(p.DIRECT)
shape = p.createCollisionShape(
    p.GEOM_HEIGHTFIELD, meshScale=[1, 1, 1], heightfieldData=ROWS,
    numHeightfieldRows=3, numHeightfieldColumns=3,
)
p.createMultiBody(0, shape)
ours = [p.rayTest([0.01, y, 10], [0.01, y, -10])[0][3][2] for y in AT]
model = mujoco.MjModel.from_xml_string(f"""<mujoco><asset>
<hfield name="h" nrow="3" ncol="3" size="1 1 4 .1" elevation="{' '.join(map(str, ROWS))}"/></asset>
<worldbody><geom type="hfield" hfield="h"/></worldbody></mujoco>""")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
down, hit = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
theirs = [
    10 - mujoco.mj_ray(model, data, np.array([0.01, y, 10.0]), down, None, 1, -1, hit, None) for y in AT
]
with open(sys.argv[1], "w") as seen:
    print("pybullet:", *(f"{z:.1f}" for z in ours), file=seen)
    print("mujoco:", *(f"{z:.1f}" for z in theirs), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7, mujoco 4.0.0"
echo "guess: the rows 0, 1, 4 rise with y from z = 0 in both: 0.1, 1.0 and 3.7 at y = -0.9, 0 and 0.9"
echo "seen:"
cat seen
printf 'pybullet: -1.9 -1.0 1.7\nmujoco: 3.7 1.0 0.1\n' | cmp - seen
