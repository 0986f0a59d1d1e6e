#!/usr/bin/env bash
# AHRS: five filters for a gyro and an accelerometer; one turns the other way, and one not at all.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet AHRS==0.4.0 numpy==2.3.5
cat > "$folder/try.py" <<'PYTHON'
import numpy as np
from ahrs.filters import AQUA, EKF, Complementary, Madgwick, Mahony

# Level, turning about the vertical at 1 rad/s for a second, at 100 Hz.
rates, gravity = np.tile([0, 0, 1.0], (101, 1)), np.tile([0, 0, 9.81], (101, 1))
for kind in (Madgwick, Mahony, EKF, AQUA, Complementary):
    w, _, _, z = kind(gyr=rates, acc=gravity, frequency=100.0).Q[-1]
    print(f"{kind.__name__}: {2 * np.arctan2(z, w) + 0.0:.2f} rad")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "AHRS 0.4.0"
echo "guess: 1 rad from each of them"
echo "seen:  AQUA has the inverse, -1 rad; Complementary, without a magnetometer, takes the yaw as 0 each time"
echo "       and leaves the gyro out"
diff - "$folder/seen" <<'SEEN'
Madgwick: 1.00 rad
Mahony: 1.00 rad
EKF: 1.00 rad
AQUA: -1.00 rad
Complementary: 0.00 rad
SEEN
