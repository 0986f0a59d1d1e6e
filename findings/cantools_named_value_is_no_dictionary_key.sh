#!/usr/bin/env bash
# cantools: a decoded signal with a name for its value equals that name, not its number, and is no key of a dictionary.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
cat > "$folder/run.py" <<'PYTHON'
import sys

import cantools

DBC = """VERSION ""
BU_: A
BO_ 256 M: 8 A
 SG_ gear : 0|8@1+ (1,0) [0|3] "" A
VAL_ 256 gear 1 "first" ;
"""
gear = cantools.database.load_string(DBC, "dbc").decode_message("M", bytes([1] + 7 * [0]))["gear"]
with open(sys.argv[1], "w") as seen:
    print(type(gear).__name__, gear == 1, gear == "first", file=seen)
    try:
        print({"first": "entry"}.get(gear), file=seen)
    except TypeError as exc:
        print("TypeError:", str(exc).split()[0], file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "cantools 45.1.0"
echo "guess: what equals \"first\" finds the entry of \"first\" in a dictionary"
echo "seen:"
cat seen
printf 'NamedSignalValue False True\nTypeError: unhashable\n' | cmp - seen
