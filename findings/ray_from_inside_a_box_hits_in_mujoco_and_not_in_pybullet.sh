#!/usr/bin/env bash
# A ray that starts inside a box: MuJoCo reports the wall that it leaves through, PyBullet nothing.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pybullet==3.2.7 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import mujoco
import numpy as np
import pybullet

model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom type="box" size=".5 .5 .5"/></worldbody></mujoco>')
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
hit = np.zeros(1, np.int32)
print("mujoco", mujoco.mj_ray(model, data, np.zeros(3), np.array([1.0, 0, 0]), None, 1, -1, hit, None))
pybullet.connect(pybullet.DIRECT)
pybullet.createMultiBody(0, pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[0.5, 0.5, 0.5]))
body = pybullet.rayTest([0, 0, 0], [2, 0, 0])[0][0]
print("pybullet", "none" if body == -1 else body)
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "mujoco 4.0.0 and pybullet 3.2.7: a box of 1 m, a ray of 2 m from its centre"
echo "guess: both alike"
echo "seen:  0.5 m of MuJoCo, no hit of PyBullet"
printf 'mujoco 0.5\npybullet none\n' | cmp - "$folder/seen"
