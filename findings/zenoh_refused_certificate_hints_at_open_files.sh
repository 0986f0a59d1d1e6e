#!/usr/bin/env bash
# Zenoh: where mutual TLS refuses a client, the server's log has the reason, and the hint to raise the
# limit of open files, which has nothing to do with it; the client is told of no certificate at all.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2 trustme==1.2.1
cat > "$folder/try.py" <<'PYTHON'
import base64
import json
import socket
from importlib.metadata import version

import trustme
import zenoh

zenoh.init_log_from_env_or("zenoh_link_tls::unicast=warn,off")
with socket.socket() as probe:
    probe.bind(("127.0.0.1", 0))
    endpoint = f"tls/127.0.0.1:{probe.getsockname()[1]}"


def opened(mode, key, end, authority, **more):
    issued = authority.issue_cert("127.0.0.1")
    pems = {
        "root_ca_certificate": authority.cert_pem,
        f"{end}_certificate": issued.cert_chain_pems[0],
        f"{end}_private_key": issued.private_key_pem,
    }
    rows = {"mode": mode, key: [endpoint], "scouting/multicast/enabled": False, **more}
    for name, pem in pems.items():
        rows[f"transport/link/tls/{name}_base64"] = base64.b64encode(pem.bytes()).decode()
    rows["transport/link/tls/enable_mtls"] = True
    config = zenoh.Config()
    for path, value in rows.items():
        config.insert_json5(path, json.dumps(value))
    return zenoh.open(config)


router = opened("router", "listen/endpoints", "listen", trustme.CA())
try:
    opened("client", "connect/endpoints", "connect", trustme.CA(), **{"connect/timeout_ms": 2000})
except zenoh.ZError as error:
    print("client:", str(error).partition(" at ")[0])
router.close()
print("eclipse-zenoh", version("eclipse-zenoh"))
PYTHON
NO_COLOR=1 "$folder/venv/bin/python" "$folder/try.py" > "$folder/said" 2>&1
grep -h "eclipse-zenoh\|^client" "$folder/said"
echo "guess: the log says which certificate is not trusted, and the client that it was refused"
echo "seen: $(grep -o "received fatal alert.*" "$folder/said" | sort | uniq | head -1)"
grep -q "UnknownCA. Hint: increase the system open file limit" "$folder/said"
! grep "^client" "$folder/said" | grep -qi "certificate\|tls alert"
