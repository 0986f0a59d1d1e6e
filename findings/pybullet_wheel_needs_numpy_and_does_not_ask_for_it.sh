#!/usr/bin/env bash
# PyBullet: its wheel is built with NumPy and declares no dependency: installed alone, it cannot be imported.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7
{
    "$folder/venv/bin/python" -c 'import pybullet' >/dev/null 2>&1 && echo imported || echo "an error"
    "$folder/venv/bin/pip" install --quiet numpy==2.4.6
    "$folder/venv/bin/python" -c 'import pybullet' >/dev/null 2>&1 && echo imported || echo "an error"
} > "$folder/seen"
echo "pybullet 3.2.7"
echo "guess: arrays are optional: it is imported, and gives images as tuples"
echo "seen:  alone, then with NumPy:"
cat "$folder/seen"
printf 'an error\nimported\n' | cmp - "$folder/seen"
