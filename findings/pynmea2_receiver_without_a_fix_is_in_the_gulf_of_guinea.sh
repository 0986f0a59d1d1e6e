#!/usr/bin/env bash
# pynmea2: a sentence of a receiver without a fix has empty fields, and its latitude and longitude are
# 0.0, not None: a place in the Gulf of Guinea. The altitude of the same sentence is None.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pynmea2==1.19.0
"$folder/venv/bin/python" - <<'PYTHON'
import sys
from importlib.metadata import version

import pynmea2

SENTENCES = {
    "with a fix": "$GPGGA,120000.00,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,",
    "without a fix": "$GPGGA,120000.00,,,,,0,00,,,M,,M,,",
}
seen = {}
for name, sentence in SENTENCES.items():
    read = pynmea2.parse(sentence)
    seen[name] = (read.latitude, read.longitude, read.altitude)
print(f"pynmea2 {version('pynmea2')}")
print("guess: without a fix, all three are None")
for name, place in seen.items():
    print(f"seen {name}: latitude {place[0]}, longitude {place[1]}, altitude {place[2]}")
sys.exit(seen["without a fix"] != (0.0, 0.0, None))
PYTHON
