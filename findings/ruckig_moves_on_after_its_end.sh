#!/usr/bin/env bash
# Ruckig: after the end of a trajectory at_time goes on with the target's velocity; it does not hold the last position.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet ruckig==0.19.4
cat > "$folder/run.py" <<'PYTHON'
import sys

import ruckig

given = ruckig.InputParameter(1)
given.current_position, given.current_velocity, given.current_acceleration = [0], [0], [0]
given.target_position, given.target_velocity, given.target_acceleration = [1], [0.5], [0]
given.max_velocity, given.max_acceleration, given.max_jerk = [1], [5], [50]
way = ruckig.Trajectory(1)
ruckig.Ruckig(1).calculate(given, way)
with open(sys.argv[1], "w") as seen:
    print("end:", round(way.at_time(way.duration)[0][0], 9), file=seen)
    print("end + 1 s:", round(way.at_time(way.duration + 1)[0][0], 9), file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "ruckig 0.19.4"
echo "guess: the position at the end + 1 s is that of the end, 1.0, as the trajectory is over"
echo "seen:"
cat seen
printf 'end: 1.0\nend + 1 s: 1.5\n' | cmp - seen
