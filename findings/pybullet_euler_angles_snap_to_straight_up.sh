#!/usr/bin/env bash
# PyBullet: getEulerFromQuaternion takes a pitch within 4.5 mrad of a right angle for one; SciPy gives the orientation back to 1e-9 rad.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pybullet==3.2.7 scipy==1.17.1
cat > "$folder/run.py" <<'PYTHON'
import sys
from math import pi

import pybullet as p
from scipy.spatial.transform import Rotation

with open(sys.argv[1], "w") as seen:
    for off in (10, 4, 1):
        there = Rotation.from_euler("xyz", (0.3, pi / 2 - off * 1e-3, 0.5))
        back = p.getQuaternionFromEuler(p.getEulerFromQuaternion(there.as_quat().tolist()))
        lost = (there.inv() * Rotation.from_quat(back)).magnitude()
        theirs = there.inv() * Rotation.from_euler("xyz", there.as_euler("xyz"))
        assert theirs.magnitude() < 1e-9
        print(f"{off} mrad off: {1e3 * lost:.1f} mrad lost", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7"
echo "guess: quaternion to Euler angles and back is the same orientation, to 1e-6 rad, but for the pole itself"
echo "seen:"
cat seen
printf '10 mrad off: 0.0 mrad lost\n4 mrad off: 4.2 mrad lost\n1 mrad off: 1.0 mrad lost\n' | cmp - seen
