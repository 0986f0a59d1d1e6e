#!/usr/bin/env bash
# zstandard (Python) says in two ways that there is no memory to compress: with MemoryError, and,
# where its C library lacks it, with ZstdError. `except MemoryError` alone lets the second through.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet zstandard==0.25.0
"$folder/venv/bin/python" - <<'PYTHON'
import resource
import sys

import zstandard

CONTENT = bytes(range(256)) * (1 << 15)


def error_of(level, room):
    """Return what compressing 8 MiB raises where the process may take so many MiB more."""
    compressor = zstandard.ZstdCompressor(level)
    with open("/proc/self/statm", encoding="ascii") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    unlimited = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + (room << 20), unlimited[1]))
    try:
        compressor.compress(CONTENT)
        return "no error"
    except (MemoryError, zstandard.ZstdError) as exc:
        return f"{type(exc).__name__}({exc})"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, unlimited)


# 4 MiB are too few for the output, 16 MiB for what level 19 works with.
seen = {3: error_of(3, 4), 19: error_of(19, 16)}
print(f"zstandard {zstandard.__version__}, zstd {'.'.join(map(str, zstandard.ZSTD_VERSION))}")
print("guess: without memory, compress raises MemoryError at every level")
for level, error in seen.items():
    print(f"seen at level {level}: {error}")
as_seen = seen[3].startswith("MemoryError") and seen[19].startswith("ZstdError")
sys.exit(0 if as_seen else 1)
PYTHON
