#!/usr/bin/env bash
# PyBullet: loadMJCF takes the ranges of joints for radians where the file says nothing; MJCF, and MuJoCo, take degrees.
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
BODY = """<mujoco>{}<worldbody><body name="b" pos="0 0 1">
<joint name="j" type="hinge" axis="0 1 0" range="-90 90" limited="true"/><geom type="box" size=".1 .1 .1"/>
</body></worldbody></mujoco>"""
with open(sys.argv[1], "w") as seen:
    for name, compiler in (("default", ""), ("degree", '<compiler angle="degree"/>')):
        file = f"{name}.xml"
        with open(file, "w") as out:
            out.write(BODY.format(compiler))
        (body,) = p.loadMJCF(file)
        upper = next(p.getJointInfo(body, n)[9] for n in range(2) if p.getJointInfo(body, n)[1] == b"j")
        theirs = mujoco.MjModel.from_xml_path(file).jnt_range[0, 1]
        print(f"{name}: pybullet {upper:.4f}, mujoco {theirs:.4f}", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7, mujoco 4.0.0"
echo "guess: both read range=\"-90 90\" as -pi/2 to pi/2, in a file that names degrees and in one that does not"
echo "seen:"
cat seen
printf 'default: pybullet 90.0000, mujoco 1.5708\ndegree: pybullet 1.5708, mujoco 1.5708\n' | cmp - seen
