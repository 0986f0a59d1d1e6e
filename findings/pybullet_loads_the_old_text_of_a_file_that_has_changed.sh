#!/usr/bin/env bash
# PyBullet: loadURDF keeps the text of a file: one that is written anew is loaded as it was, also after resetSimulation, unless enableFileCaching=0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pybullet==3.2.7
cat > "$folder/run.py" <<'PYTHON'
import sys
from pathlib import Path

import pybullet as p

ROBOT = """<robot name="r"><link name="base"><inertial><mass value="{}"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>"""


def masses(caching):
    """Return the mass of a robot whose file says 1 kg, then 2 kg, in a new client."""
    client = p.connect(p.DIRECT)
    p.setPhysicsEngineParameter(enableFileCaching=caching, physicsClientId=client)
    seen = []
    for mass in (1, 2):
        Path("robot.urdf").write_text(ROBOT.format(mass))
        body = p.loadURDF("robot.urdf", physicsClientId=client)
        seen.append(p.getDynamicsInfo(body, -1, physicsClientId=client)[0])
        p.resetSimulation(physicsClientId=client)
    p.disconnect(client)
    return seen


with open(sys.argv[1], "w") as seen:
    print("as it comes:", *masses(1), file=seen)
    print("enableFileCaching=0:", *masses(0), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7: the mass of a robot before and after its file is changed from 1 kg to 2 kg"
echo "guess: 1.0 2.0 in both"
echo "seen:"
cat seen
printf 'as it comes: 1.0 1.0\nenableFileCaching=0: 1.0 2.0\n' | cmp - seen
