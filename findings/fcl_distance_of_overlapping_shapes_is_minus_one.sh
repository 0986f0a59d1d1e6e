#!/usr/bin/env bash
# python-fcl: the distance of shapes that overlap is -1 however deep, unless a signed one is asked for.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-fcl==0.7.0.11 numpy==2.2.6
cat > "$folder/try.py" <<'PYTHON'
import fcl
import numpy as np

first = fcl.CollisionObject(fcl.Sphere(1.0), fcl.Transform())
for apart in (1.9, 1.0):
    second = fcl.CollisionObject(fcl.Sphere(1.0), fcl.Transform(np.array([apart, 0.0, 0.0])))
    plain = fcl.distance(first, second)
    signed = fcl.distance(first, second, fcl.DistanceRequest(enable_signed_distance=True))
    print(apart, plain, round(signed, 3))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "python-fcl 0.7.0.11"
echo "guess: the depth as a negative distance, -0.1 and -1.0, or 0 for both"
echo "seen:  -1 for both; -0.1 and -1.0 if the request is for a signed distance"
printf '1.9 -1.0 -0.1\n1.0 -1.0 -1.0\n' | cmp - "$folder/seen"
