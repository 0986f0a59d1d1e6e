#!/usr/bin/env bash
# LCM: set_queue_capacity of a subscription does nothing with the memq provider, which tests use in place of the network; no message is ever dropped there.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet lcm==1.5.3
cat > "$folder/try.py" <<'PYTHON'
import lcm

bus = lcm.LCM("memq://")
handled = []
bus.subscribe("numbers", lambda _channel, data: handled.append(data[0])).set_queue_capacity(5)
for number in range(20):
    bus.publish("numbers", bytes([number]))
while bus.handle_timeout(50) > 0:
    pass
print(len(handled), "handled")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "lcm 1.5.3: memq://, a queue of 5, 20 messages published before the first is handled"
echo "guess: 5 are handled"
echo "seen:  20"
printf '20 handled\n' | cmp - "$folder/seen"
