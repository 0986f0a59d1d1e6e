#!/usr/bin/env bash
# FMPy: validate_result takes a result of NaN, and one that lacks the signals, for a perfect match; it hangs at a repeated time above 1024 s.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet fmpy==0.3.32 scipy==1.17.1
cat > "$folder/try.py" <<'PYTHON'
import signal

import numpy as np
from fmpy.util import validate_result


def table(time, **columns):
    rows = list(zip(time, *columns.values()))
    return np.array(rows, dtype=[("time", float), *((name, float) for name in columns)])


nan = float("nan")
print("NaN    ", validate_result(table([0, 1, 2], y=[nan, nan, nan]), table([0, 1, 2], y=[0, 1, 2])))
print("missing", validate_result(table([0, 1, 2]), table([0, 1, 2], y=[0, 1, 2])))
for event in (500, 1500):
    signal.alarm(5)
    signal.signal(signal.SIGALRM, lambda *_: exit("still busy after 5 s"))
    given = table([0, event, event, 3000], y=[0, 0, 1, 1])
    print(event, "s  ", validate_result(table([0, 3000], y=[0, 1]), given), flush=True)
PYTHON
(cd "$folder" && venv/bin/python try.py 2>&1 || true) | tee "$folder/seen"
echo "FMPy 0.3.32; the value is the share of the samples that are outside the band"
echo "guess: 1 for NaN and for a missing signal; a number for each time of an event"
echo "seen:  0; and no end for an event after 1024 s: it adds 1e-13 s until the two times differ"
printf 'NaN     0.0\nmissing 0\n500 s   0.0\nstill busy after 5 s\n' | cmp - "$folder/seen"
