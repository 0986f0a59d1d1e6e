#!/usr/bin/env bash
# Zenoh: liveliness tokens of two sessions on one key are one. Whoever watches hears neither that the
# second came nor that the first went: the key is gone when both are.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
"$folder/venv/bin/python" - "$folder/socket" <<'PYTHON'
import json
import sys
import time
from importlib.metadata import version

import zenoh

WHERE = [f"unixsock-stream/{sys.argv[1]}"]


def opened(end):
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", json.dumps(WHERE if end == "listen" else []))
    config.insert_json5("connect/endpoints", json.dumps(WHERE if end == "connect" else []))
    return zenoh.open(config)


watcher = opened("listen")
first, second = opened("connect"), opened("connect")
events = []
_watching = watcher.liveliness().declare_subscriber(
    "robots/*", lambda sample: events.append(str(sample.kind).rpartition(".")[2])
)
seen = {}
time.sleep(1)
tokens = [session.liveliness().declare_token("robots/arm") for session in (first, second)]
time.sleep(1)
seen["after both have come"] = list(events)
first.close()
time.sleep(1)
seen["after the first has gone"] = list(events)
second.close()
time.sleep(1)
seen["after both have gone"] = list(events)
watcher.close()
print(f"eclipse-zenoh {version('eclipse-zenoh')}")
print("guess: PUT PUT, then DELETE for the first, then DELETE for the second")
for when, kinds in seen.items():
    print(f"seen {when}: {' '.join(kinds)}")
sys.exit(list(seen.values()) != [["PUT"], ["PUT"], ["PUT", "DELETE"]])
PYTHON
