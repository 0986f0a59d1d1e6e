#!/usr/bin/env bash
# PyBullet: TinyRenderer looks through the corners of pixels: a box in front of the camera lies half a pixel right of and above the middle of the image, where OpenGL has it in the middle.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pybullet==3.2.7
cat > "$folder/run.py" <<'PYTHON'
import sys

import numpy as np
import pybullet as p

p.connect(p.DIRECT)
shape = p.createVisualShape(p.GEOM_BOX, halfExtents=[0.5, 0.5, 0.5])
p.createMultiBody(0, -1, shape)
view = p.computeViewMatrix([0, 0, 2.5], [0, 0, 0], [0, 1, 0])
lens = p.computeProjectionMatrixFOV(60, 1, 0.1, 10)
with open(sys.argv[1], "w") as seen:
    for size in (64, 101, 200):
        mask = p.getCameraImage(size, size, view, lens, renderer=p.ER_TINY_RENDERER)[4]
        rows, columns = np.nonzero(np.reshape(mask, (size, size)) >= 0)
        middle = (size - 1) / 2
        print(f"{size} pixels: column {columns.mean() - middle:+.1f}, row {rows.mean() - middle:+.1f}", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pybullet 3.2.7: where the middle of a box straight ahead is, from the middle of the image"
echo "guess: 0.0 and 0.0"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
64 pixels: column +0.5, row -0.5
101 pixels: column +0.5, row -0.5
200 pixels: column +0.5, row -0.5
SEEN
