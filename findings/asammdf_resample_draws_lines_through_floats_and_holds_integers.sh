#!/usr/bin/env bash
# asammdf: on one raster, a channel of floats is interpolated, and one of integers keeps its last value.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet asammdf==8.8.28
cat > "$folder/try.py" <<'PYTHON'
import asammdf
import numpy as np

seconds = np.array([0.0, 1.0, 2.0])
log = asammdf.MDF()
log.append([asammdf.Signal(np.array([0.0, 10.0, 20.0]), seconds, name="as float")])
log.append([asammdf.Signal(np.array([0, 10, 20]), seconds, name="as integer")])
raster = log.resample(0.5)
for name in ("as float", "as integer"):
    print(name, *map(int, raster.get(name).samples))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "asammdf 8.8.28: the same three samples as two channels, at every half second"
echo "guess: both alike, 0 5 10 15 20 or 0 0 10 10 20"
echo "seen:  the floats as lines, the integers held"
printf 'as float 0 5 10 15 20\nas integer 0 0 10 10 20\n' | cmp - "$folder/seen"
