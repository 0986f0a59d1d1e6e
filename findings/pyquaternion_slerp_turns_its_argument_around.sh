#!/usr/bin/env bash
# pyquaternion: slerp changes the sign of its first argument where that is the shorter way; the caller's quaternion is another one afterwards.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pyquaternion==0.9.9
cat > "$folder/try.py" <<'PYTHON'
from pyquaternion import Quaternion

start = Quaternion(1, 0, 0, 0)
end = Quaternion(axis=[0, 0, 1], degrees=300)
print("before", *(int(value) for value in start.elements))
Quaternion.slerp(start, end, 0.5)
print("after", *(int(value) for value in start.elements))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "pyquaternion 0.9.9: slerp between 0 and 300 degrees about z, and the start looked at before and after"
echo "guess: the arguments stay as they are"
echo "seen:  the start is (-1, 0, 0, 0) afterwards: the same turn, other numbers"
printf 'before 1 0 0 0\nafter -1 0 0 0\n' | cmp - "$folder/seen"
