#!/usr/bin/env bash
# Zenoh: a TLS endpoint with an IPv6 address in brackets can be listened on, and nobody can connect to
# it; TCP to the same address, and TLS to an IPv4 address, work.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2 trustme==1.2.1
"$folder/venv/bin/python" - <<'PYTHON'
import base64
import json
import socket
import sys
from importlib.metadata import version

import trustme
import zenoh

authority = trustme.CA()
issued = authority.issue_cert("127.0.0.1", "::1")


def text(pem):
    return base64.b64encode(pem.bytes()).decode()


TLS = {
    "root_ca_certificate_base64": text(authority.cert_pem),
    "listen_certificate_base64": text(issued.cert_chain_pems[0]),
    "listen_private_key_base64": text(issued.private_key_pem),
}


def opened(mode, **settings):
    config = zenoh.Config()
    rows = {"mode": mode, "scouting/multicast/enabled": False}
    rows |= {f"transport/link/tls/{key}": value for key, value in TLS.items()}
    for key, value in {**rows, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def connects(kind, host, family):
    with socket.socket(family) as probe:
        probe.bind((host.strip("[]"), 0))
        port = probe.getsockname()[1]
    endpoint = f"{kind}/{host}:{port}"
    router = opened("router", **{"listen/endpoints": [endpoint]})
    try:
        client = opened("client", **{"connect/endpoints": [endpoint], "connect/timeout_ms": 3000})
    except zenoh.ZError:
        return False
    else:
        client.close()
        return True
    finally:
        router.close()


seen = {
    "tcp to 127.0.0.1": connects("tcp", "127.0.0.1", socket.AF_INET),
    "tcp to [::1]": connects("tcp", "[::1]", socket.AF_INET6),
    "tls to 127.0.0.1": connects("tls", "127.0.0.1", socket.AF_INET),
    "tls to [::1]": connects("tls", "[::1]", socket.AF_INET6),
}
print(f"eclipse-zenoh {version('eclipse-zenoh')}")
print("guess: all four connect")
for what, does in seen.items():
    print(f"seen: {what}: {'connects' if does else 'does not connect'}")
sys.exit(list(seen.values()) != [True, True, True, False])
PYTHON
