"""A torque controller of a two-link arm, over the legacy remote API (V-REP, `simx…`).

Only joint angles are read; the velocity is their difference over the simulator's own time. V-REP
has no torque input: a torque is a largest force, towards a velocity that is never reached.

    stepbus coppelia two_link/velocity_force -- python examples/coppelia/systems/two_link.py

Add `60 0.02 2` for a PID with these gains instead of PD. Needs V-REP's client: sim.py, simConst.py
and remoteApi.so beside this file or in PYTHONPATH, or `pip install --no-deps guira==0.1.0`.
"""

import math
import sys
import time

try:
    import sim
except ImportError:
    from guira import sim

DURATION, STEP, LIMIT, UNREACHED = 10.0, 0.005, 50.0, 9999.0  # s, s, N·m, rad/s
KP, KI, KD = [float(gain) for gain in sys.argv[1:]] or (200.0, 0.0, 10.0)


def connect():
    """Return a connection; V-REP may start later than this script."""
    for _ in range(20):
        client = sim.simxStart("127.0.0.1", 19997, True, True, 2000, 1)
        if client >= 0:
            return client
        print("waiting for V-REP on port 19997")
        time.sleep(0.5)
    sys.exit("V-REP does not listen on port 19997")


def apply(client, joint, torque):
    """Emulate a torque [N·m]."""
    velocity = math.copysign(UNREACHED, torque)
    sim.simxSetJointTargetVelocity(client, joint, velocity, sim.simx_opmode_oneshot)
    sim.simxSetJointForce(client, joint, abs(torque), sim.simx_opmode_oneshot)


client = connect()
joints = [
    sim.simxGetObjectHandle(client, name, sim.simx_opmode_blocking)[1]
    for name in ("joint1", "joint2")
]
sim.simxSynchronous(client, True)
sim.simxStartSimulation(client, sim.simx_opmode_blocking)
for joint in joints:
    sim.simxGetJointPosition(client, joint, sim.simx_opmode_streaming)
sim.simxGetPingTime(client)  # the first angles have arrived

t, before, integral, squares, largest, count = 0.0, None, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], 0
while t < DURATION:
    q = [sim.simxGetJointPosition(client, joint, sim.simx_opmode_buffer)[1] for joint in joints]
    passed = 0.0 if before is None else t - before[0]
    v = [(b - a) / passed for a, b in zip(before[1], q, strict=True)] if passed else [0.0, 0.0]
    before = t, q
    wanted, wanted_v = (math.sin(t), math.cos(t)), (math.cos(t), -math.sin(t))
    sim.simxPauseCommunication(client, True)  # both torques in one message
    for i, joint in enumerate(joints):
        error = wanted[i] - q[i]
        torque = KP * error + integral[i] + KD * (wanted_v[i] - v[i])
        if abs(torque) < LIMIT or torque * error < 0.0:
            integral[i] += KI * error * STEP
        apply(client, joint, max(-LIMIT, min(LIMIT, torque)))
        if t >= 2.0:
            squares[i] += error**2
            largest[i] = max(largest[i], abs(error))
    sim.simxPauseCommunication(client, False)
    count += t >= 2.0
    sim.simxSynchronousTrigger(client)
    sim.simxGetPingTime(client)  # the step is done, and its angles are here
    if not sim.simxGetInMessageInfo(client, sim.simx_headeroffset_server_state)[1] & 1:
        break  # the simulation was stopped, or the connection is gone
    t = sim.simxGetLastCmdTime(client) / 1000.0

rms = [math.sqrt(total / max(count, 1)) for total in squares]
print(f"error from 2 s to {t:g} s: RMS {rms[0]:.5f} and {rms[1]:.5f} rad,", end=" ")
print(f"largest {largest[0]:.5f} and {largest[1]:.5f} rad")
sim.simxStopSimulation(client, sim.simx_opmode_blocking)
sim.simxFinish(client)
