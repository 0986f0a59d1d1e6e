#!/usr/bin/env bash
# coppeliasim-zmqremoteapi-client: packInt32Table writes C longs, which have 8 bytes on 64-bit Linux.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --no-deps coppeliasim-zmqremoteapi-client==2.0.4
"$folder/venv/bin/pip" install --quiet pyzmq==27.3.0 cbor2==6.3.0 2> /dev/null
"$folder/venv/bin/python" - <<'PYTHON'
import struct
import sys
from importlib.metadata import version

from coppeliasim_zmqremoteapi_client import RemoteAPIClient

# These functions are the client's own: nobody has to listen.
client = RemoteAPIClient()
packed, floats = client.packInt32Table([1, -2]), client.packFloatTable([1.0, -2.0])
print(f"coppeliasim-zmqremoteapi-client {version('coppeliasim-zmqremoteapi-client')}")
print("guess: packInt32Table([1, -2]) has 8 bytes, as packFloatTable has")
print(f"seen: packFloatTable has {len(floats)}, packInt32Table {len(packed)}: {packed.hex()}")
as_32_bits = struct.unpack("<4i", packed) if len(packed) == 16 else ()
print(f"seen: read as 32-bit integers, they are {as_32_bits}")
sys.exit(0 if len(floats) == 8 and as_32_bits == (1, 0, -2, -1) else 1)
PYTHON
