#!/usr/bin/env bash
# Zenoh: a put on `robots/*/stop` reaches the subscribers of robots/arm/stop and robots/base/stop, each
# once, and arrives under the key `robots/*/stop`: who looks up the robot by the key finds none.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
"$folder/venv/bin/python" - <<'PYTHON'
import sys
import time
from importlib.metadata import version

import zenoh

config = zenoh.Config()
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("listen/endpoints", "[]")
session = zenoh.open(config)
seen = {}
subscribers = [
    session.declare_subscriber(
        key, lambda sample, key=key: seen.setdefault(key, []).append(str(sample.key_expr))
    )
    for key in ("robots/arm/stop", "robots/base/stop")
]
session.put("robots/*/stop", b"")
time.sleep(1)
session.close()
print(f"eclipse-zenoh {version('eclipse-zenoh')}")
print("guess: each subscriber gets the sample under its own key")
for key, keys in sorted(seen.items()):
    print(f"seen by the subscriber of {key}: {keys}")
sys.exit(seen != {key: ["robots/*/stop"] for key in ("robots/arm/stop", "robots/base/stop")})
PYTHON
