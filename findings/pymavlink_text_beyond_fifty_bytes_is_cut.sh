#!/usr/bin/env bash
# pymavlink: STATUSTEXT takes a text of any length, sends its first 50 bytes, and says nothing; an int field refuses a float.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pymavlink==2.4.50
cat > "$folder/run.py" <<'PYTHON'
import sys

from pymavlink.dialects.v20 import common

sender, receiver = common.MAVLink(None), common.MAVLink(None)
with open(sys.argv[1], "w") as seen:
    (got,) = receiver.parse_buffer(sender.statustext_encode(6, b"x" * 80).pack(sender))
    print(f"text of 80: {len(got.text)} bytes arrive", file=seen)
    try:
        sender.rc_channels_override_encode(1, 1, 1500.7, 0, 0, 0, 0, 0, 0, 0).pack(sender)
        print("float in an integer: sent", file=seen)
    except Exception:
        print("float in an integer: error", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "pymavlink 2.4.50"
echo "guess: a text that the field cannot hold is refused, as a float is by an integer field"
echo "seen:"
cat seen
printf 'text of 80: 50 bytes arrive\nfloat in an integer: error\n' | cmp - seen
