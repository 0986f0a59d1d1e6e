"""Reads and writes the 14 joint angles of Baxter's arms, over the legacy remote API (V-REP).

Lists all joints by name, then moves left_s0 by 10° · sin 2πt and right_s0 by 5° · cos 2πt for 10 s,
with a target every 50 ms, and writes all measured angles to baxter.csv (degrees), and to baxter.png
if matplotlib is installed.

    stepbus coppelia baxter -- python examples/coppelia/systems/baxter.py

Give another folder for both files as the first argument. Needs V-REP's client: sim.py, simConst.py
and remoteApi.so beside this file or in PYTHONPATH, or `pip install --no-deps guira==0.1.0`.
"""

import csv
import math
import sys
from pathlib import Path

try:
    import sim
except ImportError:
    from guira import sim

JOINTS = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
ARMS = [f"{side}_{joint}" for side in ("left", "right") for joint in JOINTS]
OUT = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
BLOCKING, ONESHOT = sim.simx_opmode_blocking, sim.simx_opmode_oneshot

client = sim.simxStart("127.0.0.1", 19997, True, True, 5000, 1)
if client < 0:
    sys.exit("V-REP does not listen on port 19997")

# Handles and their order differ from model to model: only names count.
_, handles, _, _, names = sim.simxGetObjectGroupData(client, sim.sim_object_joint_type, 0, BLOCKING)
print(f"{len(names)} joints: {', '.join(names)}")
if missing := set(ARMS) - set(names):
    sys.exit(f"the model has no {', '.join(sorted(missing))}")
handle = dict(zip(names, handles, strict=True))


def read(mode):
    """Return all 14 measured angles [rad]."""
    return [sim.simxGetJointPosition(client, handle[name], mode)[1] for name in ARMS]


sim.simxSynchronous(client, True)
sim.simxStartSimulation(client, BLOCKING)
read(sim.simx_opmode_streaming)
sim.simxGetPingTime(client)  # the first angles have arrived
rows, t = [], 0.0
while t < 10.0:
    rows.append([t, *map(math.degrees, read(sim.simx_opmode_buffer))])
    targets = {
        "left_s0": 10.0 * math.sin(2.0 * math.pi * t),
        "right_s0": 5.0 * math.cos(2.0 * math.pi * t),
    }
    for name, degrees in targets.items():
        sim.simxSetJointTargetPosition(client, handle[name], math.radians(degrees), ONESHOT)
    sim.simxSynchronousTrigger(client)
    sim.simxGetPingTime(client)  # the step is done, and its angles are here
    if not sim.simxGetInMessageInfo(client, sim.simx_headeroffset_server_state)[1] & 1:
        break  # the simulation was stopped, or the connection is gone
    t = sim.simxGetLastCmdTime(client) / 1000.0
sim.simxStopSimulation(client, BLOCKING)
sim.simxFinish(client)

with (OUT / "baxter.csv").open("w", newline="") as file:
    csv.writer(file).writerows([["t", *ARMS], *rows])
largest = {name: max(abs(row[1 + ARMS.index(name)]) for row in rows) for name in targets}
print(", ".join(f"{name}: up to {degrees:.3f}°" for name, degrees in largest.items()))
try:
    import matplotlib.pyplot as plt
except ImportError:
    sys.exit()
_, axes = plt.subplots(2, 1, sharex=True)
columns = list(zip(*rows, strict=True))
for axis, first in zip(axes, (0, 7), strict=True):
    for number in range(first, first + 7):
        axis.plot(columns[0], columns[1 + number], label=ARMS[number])
    axis.set_ylabel("angle [°]")
    axis.legend(ncols=4, fontsize="small")
axes[1].set_xlabel("t [s]")
plt.savefig(OUT / "baxter.png")
