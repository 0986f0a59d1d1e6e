#!/usr/bin/env bash
# simple-pid: within 10 ms of the wall clock a controller returns its last output, whatever the new input; a simulation runs through that in no time.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet simple-pid==2.0.1
cat > "$folder/try.py" <<'PYTHON'
from simple_pid import PID

held = PID(1, 0, 0, setpoint=0)
print("without dt", *(int(held(value)) for value in (1, 5, -3)))
stepped = PID(1, 0, 0, setpoint=0)
print("with dt   ", *(int(stepped(value, dt=0.01)) for value in (1, 5, -3)))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "simple-pid 2.0.1: PID(1, 0, 0, setpoint=0), called with 1, 5 and -3 one after the other; then the same with dt=0.01"
echo "guess: -1 -5 3 both times"
echo "seen:  the first output three times without dt; with dt=0.01 it is -1 -5 3"
printf 'without dt -1 -1 -1\nwith dt    -1 -5 3\n' | cmp - "$folder/seen"
