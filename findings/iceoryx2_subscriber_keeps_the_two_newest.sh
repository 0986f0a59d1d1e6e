#!/usr/bin/env bash
# iceoryx2: a subscriber that does not read has the two newest samples; what came before is gone without an error.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet iceoryx2==0.10.0
cat > "$folder/try.py" <<'PYTHON'
import ctypes
import os

import iceoryx2

node = iceoryx2.NodeBuilder.new().create(iceoryx2.ServiceType.Ipc)
name = iceoryx2.ServiceName.new(f"joints/{os.getpid()}")
service = node.service_builder(name).publish_subscribe(ctypes.c_uint64).open_or_create()
subscriber = service.subscriber_builder().create()
publisher = service.publisher_builder().create()
for number in range(6):
    publisher.send_copy(ctypes.c_uint64(number))
seen = []
while (sample := subscriber.receive()) is not None:
    seen.append(sample.payload().contents.value)
print(seen)
PYTHON
(cd "$folder" && venv/bin/python -W ignore try.py 2>stderr) | tee "$folder/seen"
echo "iceoryx2 0.10.0 (its Python package), a service of default settings"
echo "guess: [0, 1, 2, 3, 4, 5], or the sixth send fails because a queue is full"
echo "seen:  [4, 5]"
printf '[4, 5]\n' | cmp - "$folder/seen"
