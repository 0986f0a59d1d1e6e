#!/usr/bin/env bash
# CPython and nanobind: after gc.freeze(), an import alone is reported as a leak at the end.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet ompl==2.0.1
python="$folder/venv/bin/python"
"$python" -c "import ompl.base" 2> "$folder/plain"
"$python" -c "import ompl.base, gc; gc.freeze()" 2> "$folder/frozen"
"$python" --version
echo "ompl 2.0.1"
echo "guess: gc.freeze() only makes collections faster; nothing is printed at the end"
echo "seen:  without it $(wc -l < "$folder/plain") lines; with it $(wc -l < "$folder/frozen") lines, such as:"
grep -m 1 "leaked" "$folder/frozen"
test ! -s "$folder/plain"
