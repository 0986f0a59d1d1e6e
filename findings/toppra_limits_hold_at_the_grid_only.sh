#!/usr/bin/env bash
# toppra: between the points of its own grid, a trajectory exceeds the limits that it was made for.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet toppra==0.6.10
cat > "$folder/try.py" <<'PYTHON'
import numpy as np
import toppra
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

path = toppra.SplineInterpolator([0, 0.5, 1], np.array([[0.0, 0], [1, 2], [0, 1]]))
limits = [JointVelocityConstraint(np.array([[-1, 1.0]] * 2)), JointAccelerationConstraint(np.array([[-2, 2.0]] * 2))]
trajectory = TOPPRA(limits, path).compute_trajectory(0, 0)
times = np.linspace(0, trajectory.duration, 20001)
velocity = abs(trajectory(times, 1)).max()
acceleration = abs(trajectory(times, 2)).max()
print("velocity within its limit:", bool(velocity <= 1.001))
print("acceleration within its limit:", bool(acceleration <= 2.001))
print("acceleration within its limit and a tenth:", bool(acceleration <= 2.2))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "toppra 0.6.10: a spline of three points, at most 1 rad/s and 2 rad/s^2, default grid; the trajectory at 20001 times"
echo "guess: at most 1 and 2"
echo "seen:  a few per cent more acceleration, and a little more velocity"
printf 'velocity within its limit: False\nacceleration within its limit: False\nacceleration within its limit and a tenth: True\n' | cmp - "$folder/seen"
