#!/usr/bin/env bash
# python-can: the same messages, written to .asc and to .blf, come back with other times: an .asc file starts at 0 unless relative_timestamp=False.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cat > "$folder/try.py" <<'PYTHON'
import can

for ending in ("asc", "blf"):
    with can.Logger(f"messages.{ending}") as log:
        for index in range(3):
            log.on_message_received(can.Message(timestamp=1700000000.25 + index / 8, arbitration_id=1, data=[index], is_extended_id=False))
    print(ending, *(message.timestamp for message in can.LogReader(f"messages.{ending}")))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "python-can 4.6.1: three messages at 1700000000.25 and after, written with Logger and read with LogReader"
echo "guess: the times of the messages from both"
echo "seen:  0 0.125 0.25 from .asc; of .blf the times as written"
printf 'asc 0.0 0.125 0.25\nblf 1700000000.25 1700000000.375 1700000000.5\n' | cmp - "$folder/seen"
