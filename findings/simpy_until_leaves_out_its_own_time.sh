#!/usr/bin/env bash
# SimPy: run(until=3) does nothing of what is due at 3, and leaves the clock there.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet simpy==4.1.2
cat > "$folder/try.py" <<'PYTHON'
import simpy

environment = simpy.Environment()
ticks = []


def clock():
    while True:
        ticks.append(environment.now)
        yield environment.timeout(1)


environment.process(clock())
environment.run(until=3)
print(*ticks)
print("time", environment.now)
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "SimPy 4.1.2: a process that ticks each second from 0 on, run(until=3)"
echo "guess: ticks at 0 1 2 3"
echo "seen:  ticks at 0 1 2, and the time is 3"
printf '0 1 2\ntime 3\n' | cmp - "$folder/seen"
