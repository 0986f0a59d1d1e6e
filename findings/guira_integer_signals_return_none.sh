#!/usr/bin/env bash
# guira, a Python package of V-REP's legacy client: three functions have no return statement.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --no-deps guira==0.1.0
"$folder/venv/bin/python" - <<'PYTHON'
import sys
import sysconfig
import types
from importlib.metadata import version
from pathlib import Path

# The client alone: the package itself imports more than it needs.
package = types.ModuleType("client")
package.__path__ = [str(Path(sysconfig.get_paths()["purelib"], "guira"))]
sys.modules["client"] = package
from client import sim

# Nobody is connected: each answers with an error code, where it answers.
MODE, NOBODY = sim.simx_opmode_blocking, -1
seen = {
    "simxGetInt32Signal": sim.simxGetInt32Signal(NOBODY, "a", MODE),
    "simxGetIntegerSignal": sim.simxGetIntegerSignal(NOBODY, "a", MODE),
    "simxSetInt32Signal": sim.simxSetInt32Signal(NOBODY, "a", 1, MODE),
    "simxSetIntegerSignal": sim.simxSetIntegerSignal(NOBODY, "a", 1, MODE),
}
print(f"guira {version('guira')}")
print("guess: simxGetIntegerSignal and simxGetInt32Signal are two names of one function")
for name, value in seen.items():
    print(f"seen: {name} returns {value!r}")
as_seen = seen["simxGetIntegerSignal"] is None and seen["simxSetIntegerSignal"] is None
sys.exit(0 if as_seen and None not in (seen["simxGetInt32Signal"], seen["simxSetInt32Signal"]) else 1)
PYTHON
