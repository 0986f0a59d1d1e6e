#!/usr/bin/env bash
# imufusion: without a magnetometer, the heading is held at 0 for the first 3 s: a robot that turns at
# 10 degrees/s from the start has turned by 30 degrees after 6 s. skip_startup() counts from the start.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet imufusion==1.3.3 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import sys
from importlib.metadata import version

import imufusion
import numpy as np

RATE, SPEED, SECONDS = 100, 10.0, 6  # of the default settings [Hz], [degrees/s], [s]


def heading(*, skips):
    """Return the heading after a turn about the vertical [degrees]."""
    filter_ = imufusion.Ahrs()
    if skips:
        filter_.skip_startup()
    for _ in range(RATE * SECONDS):
        filter_.update_no_magnetometer(np.array([0, 0, SPEED]), np.array([0, 0, 1.0]))
    w, _, _, z = filter_.get_quaternion()
    return float(np.degrees(2 * np.arctan2(z, w)))


seen = {"by default": heading(skips=False), "after skip_startup()": heading(skips=True)}
print(f"imufusion {version('imufusion')}")
print(f"guess: {SPEED * SECONDS:g} degrees after {SECONDS} s, in both")
for name, degrees in seen.items():
    print(f"seen {name}: {degrees:.2f} degrees")
sys.exit(not np.allclose(list(seen.values()), [30, 60], atol=0.2))
PYTHON
