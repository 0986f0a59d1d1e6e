"""Signals and recordings to plot."""

import numpy as np

from stepbus_schemas import JointCommand, JointReference, JointState
from stepbus_tools.report.curves import JointCurves
from stepbus_tools.signals import Signal, Tracking


def arm(mode="position", **state):
    states = [JointState(position=[0.1 * n], velocity=[0.0], **state) for n in range(4)]
    commands = [JointCommand(mode=mode, values=[7.0]) for _ in range(4)]
    return {
        "arm": ("JointState/1", ["j"], states),
        "command": ("JointCommand/1", ["j"], commands),
    }


def curves(*pieces):
    found = JointCurves()
    for piece in pieces:
        found.take(piece)
    return found


def reference(n):
    return JointReference(position=[0.1 * n], velocity=[1.0 * n], acceleration=[0.0])


def lines(found, quantity):
    return found.reference_of("j").of(quantity, "j")


def sliding():
    """Return a recording of an arm whose joint `slide` follows 0.1 m · sin t, and `turn` 0.1 rad."""
    steps = np.arange(2000)
    t = steps * 0.005
    wave = 0.1 * np.sin(t)[:, None] * np.ones((1, 2))
    names, types = ["turn", "slide"], {"turn": "revolute", "slide": "prismatic"}
    state = Signal(names=names, steps=steps, t=t, fields={"position": wave}, joint_types=types)
    wanted = {"position": wave, "velocity": wave, "acceleration": -wave}
    reference = Signal(names=names, steps=steps, t=t, fields=wanted)
    command = Signal(
        names=names, steps=steps, t=t, fields={"values": wave}, modes=frozenset({"torque"})
    )
    return Tracking(states={"a": state}, references={"b": reference}, commands={"c": command})
