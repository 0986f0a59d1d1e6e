#!/usr/bin/env bash
# Coal: a box on a box touches it in one point, however many are asked for; in MuJoCo and PyBullet it stands on four.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet coal==3.0.3 mujoco==4.0.0 numpy==2.4.6 pybullet==3.2.7
cat > "$folder/run.py" <<'PYTHON'
import sys

import coal
import mujoco
import numpy as np
import pybullet as p

box, above = coal.Box(1, 1, 1), coal.Transform3s()
above.setTranslation(np.array([0.0, 0.0, 0.999]))
request, result = coal.CollisionRequest(), coal.CollisionResult()
request.num_max_contacts = 100
coal.collide(box, coal.Transform3s(), box, above, request, result)

pile = """<mujoco><worldbody><geom type="box" size=".5 .5 .5"/>
<body pos="0 0 .999"><freejoint/><geom type="box" size=".5 .5 .5"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(pile)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)

p.connect(p.DIRECT)
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.5, 0.5, 0.5])
p.createMultiBody(0, shape)
top = p.createMultiBody(1, shape, basePosition=[0, 0, 0.999])
p.performCollisionDetection()
with open(sys.argv[1], "w") as seen:
    row = (result.numContacts(), data.ncon, len(p.getContactPoints(top)))
    print("coal {}, mujoco {}, pybullet {}".format(*row), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "coal 3.0.3, mujoco 4.0.0, pybullet 3.2.7"
echo "guess: with num_max_contacts = 100 the face gives its four corners, as in the engines"
echo "seen:"
cat seen
printf 'coal 1, mujoco 4, pybullet 4\n' | cmp - seen
