"""The participants of simulated runs, and their scenarios: small, coupled in a loop, repeatable."""

import contextlib
import math
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

from stepbus import Description, Method, Participant, Scenario, Step, load
from stepbus.messages import Image, JointCommand, JointReference, JointState
from stepbus_schemas import CallRecord

from .tape import FOLDER, MS, Knobs

STEP_NS = 5 * MS
_STEP_S = 1e-9 * STEP_NS
ENDS_AT = 40
"""The step at which a mission asks for the end, in the scenario that has such a one."""
_EMPTY = Path(FOLDER) / "stepbus-sim"


class Plant(Participant):
    """A joint that turns under a torque."""

    inputs: ClassVar = {"command": JointCommand}
    outputs: ClassVar = {"joint_state": JointState}

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self.position, self.velocity = 0.1, 0.0

    def describe(self) -> dict[str, Description]:
        """Return the joint."""
        return {"joint_state": Description(names=["hip"])}

    def output(self, _step: Step) -> dict[str, Any]:
        """Publish its state."""
        return {"joint_state": JointState(position=[self.position], velocity=[self.velocity])}

    def update(self, step: Step) -> None:
        """Advance by a step."""
        command = step.get("command")
        self.velocity += _STEP_S * (command.values[0] if command is not None else 0.0)
        self.position += _STEP_S * self.velocity

    def turn_to(self, position: float) -> float:
        """Put the joint at a position [rad], and return it."""
        self.position = position
        return position

    def calls(self) -> dict[str, Method]:
        """Return what can be called."""
        return {"turn_to": Method(self.turn_to, "(position [rad])", changes=True)}


class Controller(Participant):
    """A PD law."""

    inputs: ClassVar = {"joint_state": JointState, "reference": JointReference}
    outputs: ClassVar = {"command": JointCommand}

    def describe(self) -> dict[str, Description]:
        """Return the joints of the state."""
        return {"command": Description(like="joint_state")}

    def update(self, step: Step) -> dict[str, Any]:
        """Command a torque."""
        state, reference = step.read("joint_state"), step.read("reference")
        torque = 60.0 * (reference.position[0] - state.position[0]) - 2.0 * state.velocity[0]
        return {"command": JointCommand(mode="torque", values=[torque])}


class Mission(Participant):
    """A sine, whose phase comes from the seed."""

    outputs: ClassVar = {"reference": JointReference}

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self.phase = config.seed / (1 << 53)

    def describe(self) -> dict[str, Description]:
        """Return the joint."""
        return {"reference": Description(names=["hip"])}

    def update(self, step: Step) -> dict[str, Any]:
        """Publish the reference."""
        sine, cosine = math.sin(step.t + self.phase), math.cos(step.t + self.phase)
        reference = JointReference(position=[sine], velocity=[cosine], acceleration=[-sine])
        return {"reference": reference}


class Ending(Mission):
    """Ends the run."""

    def update(self, step: Step) -> dict[str, Any]:
        """Publish the reference, and ask for the end."""
        if step.index == ENDS_AT:
            step.end("done")
        return super().update(step)


class Camera(Participant):
    """Publishes pictures, which travel beside the other messages."""

    inputs: ClassVar = {"joint_state": JointState}
    outputs: ClassVar = {"picture": Image}

    def update(self, step: Step) -> dict[str, Any]:
        """Publish a grey picture."""
        state = step.read("joint_state")
        grey = int(100 + 50 * math.tanh(state.position[0]))
        lens = {"focal": (10.0, 10.0), "centre": (4.0, 2.0)}
        image = Image(width=8, height=4, encoding="rgb8", data=bytes([grey]) * 96, **lens)
        return {"picture": image}


class Viewer(Participant):
    """Says how bright the pictures are."""

    inputs: ClassVar = {"picture": Image}
    outputs: ClassVar = {"grey": JointReference}

    def describe(self) -> dict[str, Description]:
        """Return what it says."""
        return {"grey": Description(names=["grey"])}

    def update(self, step: Step) -> dict[str, Any]:
        """Publish the first pixel of the newest picture."""
        grey = step.read("picture").data[0]
        return {"grey": JointReference(position=[grey], velocity=[0.0], acceleration=[0.0])}


def _part(name: str, **more: Any) -> dict[str, Any]:
    return {"participant": f"stepbus_simulation.programs:{name}", **more}


_LOOP = {
    "plant": _part(
        "Plant",
        publishes="first",
        inputs={"command": "controller.command"},
        outputs={"joint_state": "JointState/1"},
    ),
    "controller": _part(
        "Controller",
        inputs={"joint_state": "plant.joint_state", "reference": "mission.reference"},
        outputs={"command": "JointCommand/1"},
    ),
    "mission": _part("Mission", every=4, outputs={"reference": "JointReference/1"}),
}
_SEEN = {
    "camera": _part(
        "Camera",
        every=2,
        inputs={"joint_state": "plant.joint_state"},
        outputs={"picture": {"type": "Image/1", "bulk": True}},
    ),
    "viewer": _part(
        "Viewer",
        every=2,
        inputs={"picture": "camera.picture"},
        outputs={"grey": "JointReference/1"},
    ),
}
_HELD = {name: {**_LOOP[name], "on_fault": "hold"} for name in ("controller", "mission")}

SCENARIOS: dict[str, dict[str, dict[str, Any]]] = {
    "loop": _LOOP,
    "held": _LOOP | _HELD,
    "seen": _LOOP | _SEEN,
    "called": _LOOP,
    # Another one that publishes first, and owes closing outputs.
    "twins": _LOOP | {"twin": _LOOP["plant"]},
    "ended": _LOOP | {"mission": _LOOP["mission"] | _part("Ending")},
}
"""Name in a tape → its participants: a loop, plain, held at a fault, seen by a camera, called, with
two plants, ended by its mission."""

CALLS = {
    "called": [
        CallRecord(step=step, participant="plant", method="turn_to", args=[0.1 * step])
        for step in (3, 20, 33)
    ]
}
"""Name in a tape → the calls of its run."""


@lru_cache(maxsize=64)
def scenario(name: str, steps: int, knobs: Knobs) -> Scenario:
    """Return a scenario of so many steps, with the knobs of a tape."""
    # A scenario has the files of its folder, which takes longest to read.
    _EMPTY.mkdir(exist_ok=True)
    with contextlib.chdir(_EMPTY):
        return load(as_data(name, steps, knobs))


def as_data(name: str, steps: int, knobs: Knobs) -> dict[str, Any]:
    """Return the same as plain data, as a file would have it."""
    limits = {
        f"{phase}_timeout": f"{getattr(knobs, f'{phase}_ms')}ms"
        for phase in ("spawn", "join", "ready", "step", "stop")
    }
    return {
        "name": name,
        "step": "5ms",
        "duration": f"{5 * steps}ms",
        "window": knobs.window,
        **({"batch": knobs.batch} if knobs.batch else {}),
        "participants": {name: row | limits for name, row in SCENARIOS[name].items()},
    }
