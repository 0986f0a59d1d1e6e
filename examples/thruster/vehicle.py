"""An underwater vehicle that moves up and down: two thrusters against its weight and drag."""

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

import stepbus

TYPES = stepbus.messages.load_types(Path(__file__).with_name("types.yaml"))
Depth = TYPES["Depth/1"]
Thruster = TYPES["Thruster/1"]


class Vehicle(stepbus.Participant):
    """Publishes its depth; the classes let the orchestrator refuse a scenario with others."""

    inputs: ClassVar = {"thruster": Thruster}
    outputs: ClassVar = {"depth": Depth}

    def __init__(self, config: stepbus.Config) -> None:
        super().__init__(config)
        self._dt = config.step_ns * 1e-9
        self._random = np.random.default_rng(config.seed)
        self._depth = self._rate = 0.0

    def output(self, _step: stepbus.Step) -> Mapping[str, stepbus.Message]:
        """Measure the depth."""
        noise = self._random.normal(0.0, self.config.param("noise"))
        return {"depth": Depth(depth=self._depth + noise, rate=self._rate)}

    def update(self, step: stepbus.Step) -> None:
        """Move by one step: m·a = weight − thrust − drag · v."""
        thruster = step.get("thruster", Thruster)
        lift = 0.0 if thruster is None or thruster.mode == "off" else sum(thruster.thrust)
        force = self.config.param("weight") - lift - self.config.param("drag") * self._rate
        self._rate += force / self.config.param("mass") * self._dt
        self._depth = max(0.0, self._depth + self._rate * self._dt)
