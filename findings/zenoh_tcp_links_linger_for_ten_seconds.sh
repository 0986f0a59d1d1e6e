#!/usr/bin/env bash
# Zenoh: its TCP sockets have SO_LINGER on, with 10 s. So a process with data under way to a host that
# does not answer stays for ten seconds in the close of a socket, also where it exits without closing.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
"$folder/venv/bin/python" - <<'PYTHON'
import contextlib
import json
import os
import socket
import struct
import sys
from importlib.metadata import version

import zenoh

with socket.socket() as probe:
    probe.bind(("127.0.0.1", 0))
    endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def opened(mode, key):
    config = zenoh.Config()
    for path, value in {"mode": mode, key: [endpoint], "scouting/multicast/enabled": False}.items():
        config.insert_json5(path, json.dumps(value))
    return zenoh.open(config)


def lingers():
    """Return l_onoff and l_linger of each connected TCP socket of this process."""
    found = set()
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(name))) as link:
            if link.family == socket.AF_INET:
                link.getpeername()
                option = link.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
                found.add(struct.unpack("ii", option))
    return found


router = opened("router", "listen/endpoints")
client = opened("client", "connect/endpoints")
seen = lingers()
client.close()
router.close()
print(f"eclipse-zenoh {version('eclipse-zenoh')}")
print("guess: (0, 0), as every socket begins")
print(f"seen: {sorted(seen)}")
sys.exit(seen != {(1, 10)})
PYTHON
