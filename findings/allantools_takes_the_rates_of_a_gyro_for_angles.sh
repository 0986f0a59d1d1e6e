#!/usr/bin/env bash
# AllanTools: the deviation of a gyro's rates is that of angles, unless they are called a frequency.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet AllanTools==2024.6 numpy==2.4.6
cat > "$folder/try.py" <<'PYTHON'
import allantools
import numpy as np

rates = np.random.default_rng(1).normal(size=100_000)  # 1 rad/s, white, at 100 Hz
for options in ({}, {"data_type": "freq"}):
    _, found, _, _ = allantools.oadev(rates, rate=100.0, taus=[0.1, 1.0, 10.0], **options)
    print(options, found.round(2).tolist())
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "AllanTools 2024.6"
echo "guess: white noise of 1 rad/s at 100 Hz: 0.32, 0.10 and 0.03 rad/s over 0.1, 1 and 10 s, falling by the"
echo "       root of ten"
echo "seen:  17.2, 1.73 and 0.17, falling by ten: the default takes numbers for phases, and differentiates them"
echo "       twice; data_type='freq' gives what was guessed"
diff - "$folder/seen" <<'SEEN'
{} [17.22, 1.73, 0.17]
{'data_type': 'freq'} [0.31, 0.1, 0.03]
SEEN
