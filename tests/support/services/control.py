"""Controller and mission without a bus: configurations and steps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import stepbus_scenarios
from stepbus.testing import Bench
from stepbus_controller.controller import Controller
from stepbus_mission.mission import Mission
from stepbus_participant import Config
from stepbus_schemas import Description, InputConfig, OutputConfig

TWO_LINK = Path(stepbus_scenarios.__file__).parent / "two_link"
STEP_NS = 5_000_000
JOINTS = ["joint1", "joint2"]
SINE = {
    "task": "sine",
    "joints": JOINTS,
    "phase": {"joint1": 0, "joint2": np.pi / 2},
}


def make_config(
    name: str,
    inputs: dict[str, str],
    outputs: dict[str, str],
    folder: Path = TWO_LINK,
    *,
    params: dict[str, Any],
    step_ns: int = STEP_NS,
    **more: Any,
) -> Config:
    """Return the configuration of a participant; inputs, outputs: port → type."""
    return Config(
        name=name,
        inputs={n: InputConfig(source="other", port=n, type=t) for n, t in inputs.items()},
        outputs={n: OutputConfig(type=t) for n, t in outputs.items()},
        folder=folder,
        params=params,
        step_ns=step_ns,
        **{"every": 1, "seed": 0, **more},
    )


def controller_config(folder: Path = TWO_LINK, every: int = 1, **params: Any) -> Config:
    """Return the configuration of a controller wired as in two_link."""
    inputs = {"joint_state": "JointState/1", "reference": "JointReference/1"}
    outputs = {"command": "JointCommand/1", "status": "ControllerStatus/1"}
    return make_config("controller", inputs, outputs, folder, params=params, every=every)


def mission_config(folder: Path = TWO_LINK, **params: Any) -> Config:
    """Return the configuration of a mission that also tells its events."""
    outputs = {"reference": "JointReference/1", "event": "Event/1"}
    return make_config("mission", {}, outputs, folder, params=params)


class Stand(Bench):
    """A started participant on the bench."""

    update = Bench.step


def make_controller(config: Config, names: list[str] | None = None) -> Stand:
    """Return a started controller; names: the joint order of both its inputs."""
    description = Description(names=names or JOINTS)
    descriptions = {"joint_state": description, "reference": description}
    return Stand(Controller, config, descriptions)


def make_mission(config: Config) -> Stand:
    """Return a started mission."""
    return Stand(Mission, config)
