#!/usr/bin/env bash
# Box2D: a body moves two metres a step at most; its velocity is cut down to that, without a word.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet Box2D==2.3.10
cat > "$folder/try.py" <<'PYTHON'
import Box2D

for speed in (100.0, 1000.0):
    for rate in (60, 1000):
        world = Box2D.b2World(gravity=(0, 0))
        body = world.CreateDynamicBody(position=(0, 0))
        body.CreateCircleFixture(radius=0.5, density=1)
        body.linearVelocity = (speed, 0)
        for _ in range(rate):
            world.Step(1 / rate, 8, 3)
        print(f"{speed:g} m/s, {rate} Hz: {body.position.x:.1f} m, {body.linearVelocity.x:.1f} m/s")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "Box2D 2.3.10"
echo "guess: 100 m and 1,000 m in a second, at any rate"
echo "seen:  1,000 m/s at 60 Hz become 120 m/s in the first step, and stay so; at 1,000 Hz they are kept"
diff - "$folder/seen" <<'SEEN'
100 m/s, 60 Hz: 100.0 m, 100.0 m/s
100 m/s, 1000 Hz: 100.0 m, 100.0 m/s
1000 m/s, 60 Hz: 120.0 m, 120.0 m/s
1000 m/s, 1000 Hz: 1000.0 m, 1000.0 m/s
SEEN
