"""Compares what a script did with the same of a native scenario, read from both recordings.

python examples/coppelia/systems/compare.py RUN NATIVE_RUN [baxter.csv]
"""

import csv
import math
import sys
from pathlib import Path

import numpy as np

import stepbus

SETTLED = 2.0  # s


def compare(script, native, seen=""):
    """Return figures by name: `script` and `native` of each, or one number of both.

    script, native: folders of runs. seen: angles that the script wrote, in degrees.
    """
    runs = [stepbus.Recording(folder) for folder in (script, native)]
    found = {}
    for who, run in zip(("script", "native"), runs, strict=True):
        state = run["plant/joint_state"]
        found[f"{who}: end [s]"] = float(state.t[-1])
        if "mission/reference" in runs[1].ports:
            wanted = runs[1]["mission/reference"]
            count = min(len(wanted.t), len(state.t))
            settled = wanted.t[:count] >= SETTLED
            for index, joint in enumerate(wanted.names):
                q = state["position"][:count, list(state.names).index(joint)]
                error = (wanted["position"][:count, index] - q)[settled]
                if np.ptp(wanted["position"][:, index]):
                    found[f"{who}: RMS error of {joint} [rad]"] = math.sqrt(np.mean(error**2))
                    found[f"{who}: largest error of {joint} [rad]"] = float(np.abs(error).max())
        if "plant/poses" in run.ports:
            poses = run["plant/poses"]
            cube = poses["position"][:, list(poses.names).index("cube_start_1")]
            found[f"{who}: end of the cube [m]"] = [round(float(x), 5) for x in cube[-1]]
            found[f"{who}: highest of the cube [m]"] = round(float(cube[:, 2].max()), 5)
            held = run["plant/gripper"]["holding"]
            found[f"{who}: held for [s]"] = float(np.sum(held) * np.diff(poses.t)[0])
    states = [run["plant/joint_state"] for run in runs]
    joints = [joint for joint in states[1].names if joint in states[0].names]
    count = min(len(state.t) for state in states)
    columns = [[list(state.names).index(joint) for joint in joints] for state in states]
    one, two = (s["position"][:count, c] for s, c in zip(states, columns, strict=True))
    found["largest difference of a joint [rad]"] = float(np.abs(one - two).max())
    if seen:
        with Path(seen).open(newline="") as file:
            head, *rows = list(csv.reader(file))
        angles = np.radians(np.array(rows, dtype=float)[:, 1:])
        names = [list(states[0].names).index(joint) for joint in head[1:]]
        recorded = states[0]["position"][: len(rows), names]
        found["angles seen and recorded are the same float32"] = np.array_equal(
            np.float32(angles), np.float32(recorded)
        )
    return found


if __name__ == "__main__":
    for name, figure in compare(*sys.argv[1:]).items():
        print(f"{name}: {figure:.6g}" if isinstance(figure, float) else f"{name}: {figure}")
