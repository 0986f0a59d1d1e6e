"""The task, in plain Python: a planar two-link arm and a PD controller, the same for every tool.

It needs the standard library only, so that each tool's own environment can import it, and no
physics engine decides a result. A run of 400 steps of 5 ms is 2 s of simulated time:
at step k the controller reads the state of step k, and the plant applies the torque of step k.

The environment variable COMPARISON_OUT names a folder. There the plant writes `trace.txt`, one
line a step with the exact bits of each number; the controller stops for good at the step
COMPARISON_STALL, after it has written its process id to `stalled`. That lets `run.py` strike a
process of any tool at the same step, from outside.
"""

import os
import time
from math import cos, sin
from pathlib import Path

STEP_S = 0.005
STEPS = 400
JOINTS = ("joint1", "joint2")
EFFORT = 50.0
"""Largest torque of each joint [N·m]."""
KP, KD = 60.0, 8.0
"""Gains [N·m/rad], [N·m·s/rad]."""
_MASS, _LENGTH, _GRAVITY = 1.0, 1.0, 9.81
"""Of each link: point mass at its end [kg], length [m]; [m/s²]."""

Pair = tuple[float, float]


def _out(name: str) -> Path | None:
    folder = os.environ.get("COMPARISON_OUT")
    return Path(folder) / name if folder else None


class Trace:
    """What the plant did, to the bit: `run.py` compares it between runs and tools."""

    def __init__(self) -> None:
        path = _out("trace.txt")
        self._file = path.open("w", buffering=1) if path else None

    def write(self, step: int, position: Pair, velocity: Pair, torque: Pair) -> None:
        """Add the state and the torque of a step."""
        if self._file is not None:
            numbers = (*position, *velocity, *torque)
            self._file.write(f"{step} {' '.join(float(x).hex() for x in numbers)}\n")


class Arm:
    """Two links in the vertical plane; semi-implicit Euler."""

    def __init__(self) -> None:
        self.position: Pair = (0.0, 0.0)
        self.velocity: Pair = (0.0, 0.0)
        self.step = 0
        self._trace = Trace()

    def advance(self, torque: Pair) -> None:
        """Apply a torque [N·m] for one step."""
        self._trace.write(self.step, self.position, self.velocity, torque)
        acceleration = _acceleration(self.position, self.velocity, torque)
        v1, v2 = (v + a * STEP_S for v, a in zip(self.velocity, acceleration, strict=True))
        self.velocity = (v1, v2)
        self.position = (self.position[0] + v1 * STEP_S, self.position[1] + v2 * STEP_S)
        self.step += 1


def _acceleration(position: Pair, velocity: Pair, torque: Pair) -> Pair:
    """Solve M(q) a + c(q, v) + g(q) = torque for two point masses on massless links."""
    (q1, q2), (v1, v2) = position, velocity
    inertia, weight = _MASS * _LENGTH * _LENGTH, _MASS * _GRAVITY * _LENGTH
    m11, m12, m22 = inertia * (3 + 2 * cos(q2)), inertia * (1 + cos(q2)), inertia
    coriolis = inertia * sin(q2)
    outer = weight * cos(q1 + q2)
    b1 = torque[0] + coriolis * (2 * v1 * v2 + v2 * v2) - 2 * weight * cos(q1) - outer
    b2 = torque[1] - coriolis * v1 * v1 - outer
    determinant = m11 * m22 - m12 * m12
    return (m22 * b1 - m12 * b2) / determinant, (m11 * b2 - m12 * b1) / determinant


def reference(step: int) -> tuple[Pair, Pair]:
    """Return where the joints should be [rad], and how fast [rad/s]."""
    t = step * STEP_S
    return (sin(t), cos(t)), (cos(t), -sin(t))


def control(step: int, position: Pair, velocity: Pair) -> Pair:
    """Return the torque of a PD controller [N·m], within ±EFFORT."""
    _stall(step)
    goal, speed = reference(step)
    rows = zip(goal, position, speed, velocity, strict=True)
    t1, t2 = (KP * (qd - q) + KD * (vd - v) for qd, q, vd, v in rows)
    return min(max(t1, -EFFORT), EFFORT), min(max(t2, -EFFORT), EFFORT)


def _stall(step: int) -> None:
    if os.environ.get("COMPARISON_STALL") != str(step):
        return
    stalled = _out("stalled")
    if stalled is not None:
        stalled.with_suffix(".new").write_text(str(os.getpid()))
        stalled.with_suffix(".new").rename(stalled)
    while True:  # no time-out: run.py ends every process that it has started
        time.sleep(60)


def main() -> None:
    """Run both in a plain loop: the result that every tool is compared with."""
    arm = Arm()
    for step in range(STEPS):
        arm.advance(control(step, arm.position, arm.velocity))


if __name__ == "__main__":
    main()
