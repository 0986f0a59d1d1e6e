#!/usr/bin/env bash
# Klampt: the nine numbers of a rotation are its columns one after the other, not its rows.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet klampt==0.10.1.post1
cat > "$folder/run.py" <<'PYTHON'
import sys
from math import pi

from klampt.math import so3

with open(sys.argv[1], "w") as seen:
    print([round(x) for x in so3.from_rpy((0, 0, pi / 2))], file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "klampt 0.10.1.post1"
echo "guess: a quarter turn about z, read row by row, is [0, -1, 0, 1, 0, 0, 0, 0, 1]"
echo "seen:"
cat seen
printf '[0, 1, 0, -1, 0, 0, 0, 0, 1]\n' | cmp - seen
