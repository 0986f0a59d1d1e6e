#!/usr/bin/env bash
# laspy: a new LAS file has a scale of 0.01: points in metres are rounded to centimetres as they are
# assigned, without a word. A header with scales of 0.001 keeps millimetres.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet laspy==2.7.0 numpy==2.4.6
"$folder/venv/bin/python" - "$folder/scan.las" <<'PYTHON'
import sys
from importlib.metadata import version

import laspy
import numpy as np

POINTS = np.array([1.2345, 1.2367, 2.0004])


def read_back(header):
    las = laspy.create() if header is None else laspy.LasData(header)
    las.x, las.y, las.z = POINTS, np.zeros(3), np.zeros(3)
    las.write(sys.argv[1])
    return np.array(laspy.read(sys.argv[1]).x).tolist()


fine = laspy.LasHeader(point_format=3, version="1.2")
fine.scales = [1e-4] * 3
seen = {"laspy.create()": read_back(None), "a header with scales of 1e-4": read_back(fine)}
print(f"laspy {version('laspy')}")
print(f"guess: {POINTS.tolist()} come back to a millimetre or better")
for name, points in seen.items():
    print(f"seen with {name}: {points}")
rounded = np.allclose(seen["laspy.create()"], [1.23, 1.24, 2.0], atol=1e-9)
sys.exit(not (rounded and np.allclose(seen["a header with scales of 1e-4"], POINTS, atol=1e-9)))
PYTHON
