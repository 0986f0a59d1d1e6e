#!/usr/bin/env bash
# pySerial: a loop:// port takes 960 bytes at 9600 baud at once; with a write time-out shorter than the second that they would take, it waits that long and takes none.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pyserial==3.5
cat > "$folder/try.py" <<'PYTHON'
import time

import serial

for options in ({}, {"write_timeout": 0.2}):
    port = serial.serial_for_url("loop://", baudrate=9600, timeout=0, **options)
    began = time.monotonic()
    try:
        said = f"{port.write(bytes(960))} written"
    except serial.SerialTimeoutException as exc:
        said = f"{type(exc).__name__}: {exc}"
    lasted = "at once" if time.monotonic() - began < 0.1 else "later"
    print(f"{options}: {said}, {lasted}; {port.in_waiting} bytes to read")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "pyserial 3.5: 960 bytes into loop:// at 9600 baud, without and with write_timeout=0.2"
echo "guess: a loop in memory has no baud rate: written at once both times"
echo "seen:  at once without a time-out; with one, SerialTimeoutException after 0.2 s, and nothing is there to read"
printf '{}: 960 written, at once; 960 bytes to read\n{%swrite_timeout%s: 0.2}: SerialTimeoutException: Write timeout, later; 0 bytes to read\n' "'" "'" | cmp - "$folder/seen"
