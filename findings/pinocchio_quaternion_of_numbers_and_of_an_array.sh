#!/usr/bin/env bash
# Pinocchio: Quaternion of four numbers takes w first, of an array of four w last.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0
cat > "$folder/try.py" <<'PYTHON'
import math

import numpy as np
import pinocchio

for name, quaternion in (
    ("numbers", pinocchio.Quaternion(1.0, 0.0, 0.0, 0.0)),
    ("array", pinocchio.Quaternion(np.array([1.0, 0.0, 0.0, 0.0]))),
):
    print(f"{name}: {math.degrees(2 * math.acos(quaternion.w)):.0f} degrees")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "pin 4.1.0: Quaternion(1, 0, 0, 0) and Quaternion(np.array([1, 0, 0, 0])), each as the angle of its turn"
echo "guess: the same turn"
echo "seen:  the numbers are no turn, the array a half turn about x"
printf 'numbers: 0 degrees\narray: 180 degrees\n' | cmp - "$folder/seen"
