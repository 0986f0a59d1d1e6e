#!/usr/bin/env bash
# spatialmath: rpy2r(roll, pitch, yaw, order='xyz') turns by yaw about x and by roll about z.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet spatialmath-python==1.1.18
cat > "$folder/try.py" <<'PYTHON'
from spatialmath.base import rpy2r

for order in ("zyx", "xyz"):
    turned = rpy2r(90, 0, 0, unit="deg", order=order)[:, 0]
    print(order, *(abs(round(value)) for value in turned))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "spatialmath-python 1.1.18: rpy2r(90, 0, 0, unit='deg') with order zyx and xyz; where the x axis goes"
echo "guess: roll is about x both times, so the x axis stays"
echo "seen:  with xyz it becomes y: roll is about z"
printf 'zyx 1 0 0\nxyz 0 1 0\n' | cmp - "$folder/seen"
