"""Participants for tests: a plant, a controller and a mission of two joints, which can go wrong.

Their parameters `fault` and `at`: what goes wrong, and at which step; or else, as a program,
`joints.py ROLE [FAULT STEP]`.
"""

import os
import signal
import sys
import time
from typing import ClassVar

import msgspec

import stepbus
from stepbus import (
    Config,
    Description,
    Event,
    JointCommand,
    JointReference,
    JointState,
    Participant,
)
from stepbus_participant.session import outbox
from stepbus_schemas import Outputs

ROLE, FAULT, AT = ([*sys.argv[1:], "", "", "0"] if __name__ == "__main__" else ["", "", "0"])[:3]


class Mute(Exception):
    """Cannot say what it is."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


def go_wrong(fault: str) -> None:
    """Do what the parameters say."""
    if fault == "raise":
        raise ValueError("the knee is bent the wrong way")
    if fault == "mute":
        raise Mute
    if fault == "surrogate":
        raise ValueError("the knee \ud800")
    if fault in {"exit", "leave"}:
        (os._exit if fault == "exit" else sys.exit)(3)
    if fault == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if fault == "stop":
        os.kill(os.getpid(), signal.SIGSTOP)
    if fault == "hang":
        print("it hangs", flush=True)
        time.sleep(1000)
    if fault == "nap":
        time.sleep(1.5)
    if fault == "deaf":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(1000)


NONSENSE = ("message", "envelope", "skip", "time", "garbage")


class Faulty(Participant):
    """Goes wrong at one step, or before the first."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.fault = config.params.get("fault", FAULT)
        self.at = int(config.params.get("at", AT or 0))
        if self.at < 0:
            go_wrong(self.fault)

    def check(self, step: stepbus.Step) -> None:
        if step.index == self.at:
            go_wrong(self.fault)


class Plant(Faulty):
    """Two integrators."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.position = [0.0, 1.0]

    def describe(self):
        return {"joint_state": Description(names=["hip", "knee"])}

    def calls(self):
        return {
            "position": stepbus.Method(self.ask, "I: position of a joint [rad]"),
            "put": stepbus.Method(self.put, "I RAD: puts a joint somewhere", changes=True),
            "text": stepbus.Method("x".__mul__, "N: a text of this length"),
            "sleep": stepbus.Method(time.sleep, "S: takes its time"),
        }

    def ask(self, joint):
        return self.position[joint]

    def put(self, joint, position):
        if abs(position) > 3:
            raise stepbus.errors.CallError(f"{position} is beyond the stop")
        self.position[joint] = position

    def output(self, step):
        return {"joint_state": JointState(position=list(self.position))}

    def update(self, step):
        self.check(step)
        command = step.read("command", JointCommand)
        self.position = [q + 1e-3 * v for q, v in zip(self.position, command.values, strict=True)]


class Controller(Faulty):
    """Proportional; ends the run, or talks nonsense, when it is told to."""

    def describe(self):
        return {"command": Description(like="joint_state")}

    def update(self, step):
        self.check(step)
        state = step.read("joint_state", JointState)
        reference = step.get("reference", JointReference)
        wanted = reference.position if reference else [0.0, 0.0]
        values = [r - q for r, q in zip(wanted, state.position, strict=True)]
        if step.index == self.at and self.fault == "end":
            step.end("the goal is reached")
        if step.index == self.at and self.fault == "port":
            return {"komand": JointCommand(mode="torque", values=values)}
        if step.index == self.at and self.fault == "type":
            return {"command": Event(level="info", text="hello")}
        if step.index == self.at and self.fault == "mistyped":
            return {"command": JointCommand(mode="torque", values="many")}
        if step.index == self.at and self.fault == "huge":
            return {"command": JointCommand(mode="torque", values=[0.0] * 10_000)}
        if step.index == self.at and self.fault in NONSENSE:
            # Past the library's own checks.
            real = outbox.encode
            outbox.encode = lambda message: self.spoil(real, message)
        return {"command": JointCommand(mode="torque", values=values)}

    def spoil(self, real, message):
        if self.fault == "message" and isinstance(message, JointCommand):
            return msgspec.msgpack.encode({"mode": "torque", "values": "many"})
        if self.fault == "envelope" and isinstance(message, Outputs):
            return msgspec.msgpack.encode({"token": message.token, "step": "seven"})
        if self.fault == "skip" and isinstance(message, Outputs):
            # With the time of that step: whoever sees it first names the same fault.
            step = message.step + 1
            t_ns = message.t_ns // message.step * step
            return real(msgspec.structs.replace(message, step=step, t_ns=t_ns))
        if self.fault == "time" and isinstance(message, Outputs):
            return real(msgspec.structs.replace(message, t_ns=message.t_ns + 1))
        if self.fault == "garbage" and isinstance(message, Outputs):
            return b"\xc1 this is no MessagePack"
        return real(message)

    def close(self) -> None:
        if self.fault == "hang-at-close":
            time.sleep(1000)
        if self.fault == "raise-at-close":
            raise RuntimeError("cannot let go")


class Future(Controller):
    """Was written for another version of a message."""

    outputs: ClassVar = {"command": "JointCommand/2"}


class Mission(Faulty):
    """A ramp."""

    def update(self, step):
        self.check(step)
        return {
            "reference": JointReference(
                position=[step.t, 0.5], velocity=[1.0, 0.0], acceleration=[0.0, 0.0]
            )
        }


ROLES = {"plant": Plant, "controller": Controller, "future": Future, "mission": Mission}

if __name__ == "__main__":
    raise SystemExit(stepbus.main(ROLES[ROLE]))
