#!/usr/bin/env bash
# FMPy: validate_result takes a result of NaN, and one that lacks the signals, for a perfect match.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet fmpy==0.3.32 scipy==1.17.1
cat > "$folder/try.py" <<'PYTHON'
import numpy as np
from fmpy.util import validate_result


def table(time, **columns):
    rows = list(zip(time, *columns.values()))
    return np.array(rows, dtype=[("time", float), *((name, float) for name in columns)])


nan = float("nan")
print("NaN    ", validate_result(table([0, 1, 2], y=[nan, nan, nan]), table([0, 1, 2], y=[0, 1, 2])))
print("missing", validate_result(table([0, 1, 2]), table([0, 1, 2], y=[0, 1, 2])))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>&1) | tee "$folder/seen"
echo "FMPy 0.3.32; the value is the share of the samples that are outside the band"
echo "guess: 1 for both"
echo "seen:  0 for both"
printf 'NaN     0.0\nmissing 0\n' | cmp - "$folder/seen"
