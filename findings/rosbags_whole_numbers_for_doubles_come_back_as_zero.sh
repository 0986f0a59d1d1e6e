#!/usr/bin/env bash
# rosbags: an array of int64 for a field of float64[] is written as it lies in memory, without an
# error: positions 1 and 2 come back as 5e-324 and 1e-323. A list, or an array of float32, is refused.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import sys
from importlib.metadata import version

import numpy as np
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
NAME = "sensor_msgs/msg/JointState"
NONE = np.zeros(0)
header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](0, 0), "")


def read_back(position):
    """Return the positions of a message that is written and read, or the error."""
    message = store.types[NAME](header, ["joint1", "joint2"], position, NONE, NONE)
    try:
        return store.deserialize_cdr(store.serialize_cdr(message, NAME), NAME).position.tolist()
    except (AttributeError, ValueError) as exc:
        return type(exc).__name__


seen = {
    "array of float64": read_back(np.array([1.0, 2.0])),
    "array of int64": read_back(np.array([1, 2])),
    "array of float32": read_back(np.array([1, 2], dtype=np.float32)),
    "list of floats": read_back([1.0, 2.0]),
}
print(f"rosbags {version('rosbags')}")
print("guess: all four are converted, or refused; none is another number")
for given, value in seen.items():
    print(f"seen of an {given}: {value}")
bits = np.array([1, 2]).view(np.float64).tolist()
sys.exit(list(seen.values()) != [[1.0, 2.0], bits, "ValueError", "AttributeError"])
PYTHON
