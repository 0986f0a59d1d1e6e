#!/usr/bin/env bash
# PyBullet: loadMJCF weighs every shape with 1000 kg/m3; `mass` and `density` of a geom are not read.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pybullet==3.2.7 mujoco==4.0.0
cat > "$folder/run.py" <<'PYTHON'
import sys

import mujoco
import pybullet as p

p.connect(p.DIRECT)
BODY = """<mujoco><worldbody><body name="b" pos="0 0 1"><joint type="slide" axis="0 0 1"/>
<geom type="box" size=".1 .1 .1" {}/></body></worldbody></mujoco>"""
with open(sys.argv[1], "w") as seen:
    for number, weight in enumerate(('mass="2"', 'density="500"')):
        file = f"{number}.xml"
        with open(file, "w") as out:
            out.write(BODY.format(weight))
        (body,) = p.loadMJCF(file)
        ours = sum(p.getDynamicsInfo(body, n)[0] for n in range(-1, p.getNumJoints(body)))
        theirs = mujoco.MjModel.from_xml_path(file).body_mass.sum()
        print(f"{weight}: pybullet {ours:.1f}, mujoco {theirs:.1f}", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7, mujoco 4.0.0"
echo "guess: a box with a mass of 2 weighs 2, one of 0.008 m3 with a density of 500 weighs 4, as in MuJoCo"
echo "seen:"
cat seen
printf 'mass="2": pybullet 8.0, mujoco 2.0\ndensity="500": pybullet 8.0, mujoco 4.0\n' | cmp - seen
