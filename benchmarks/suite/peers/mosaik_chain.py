"""The chain under mosaik, each simulator a process.

`python -m benchmarks.suite.peers.mosaik_chain STEPS`.
"""

import sys
from typing import Any

import mosaik
import mosaik_api_v3
from benchmarks.suite.clock import Clock

from .arm import Controller, Plant, reference

PORTS = {"plant": "state", "controller": "command", "mission": "reference"}
SOURCES = {"plant": ["command"], "controller": ["state", "reference"], "mission": []}


class Simulator(mosaik_api_v3.Simulator):  # type: ignore[misc]
    """One of the three."""

    def __init__(self, name: str) -> None:
        attributes = [PORTS[name], *SOURCES[name]]
        model = {"public": True, "params": [], "attrs": attributes}
        super().__init__({"type": "time-based", "models": {"M": model}})
        self._name = name
        self._worker: Any = {"plant": Plant, "controller": Controller, "mission": object}[name]()
        self._out = ""
        self._clock: Clock | None = None

    def create(self, num: int, model: str, **_params: Any) -> list[dict[str, str]]:
        return [{"eid": "e", "type": model}]

    def step(self, time: int, inputs: Any, max_advance: int) -> int:
        got = {
            key: bytes.fromhex(next(iter(values.values())))
            for key, values in inputs.get("e", {}).items()
        }
        if self._name == "plant":
            self._clock = self._clock or Clock()
            if "command" in got:
                self._worker.step(got["command"])
                self._clock.tick()
            self._out = self._worker.state().hex()
        elif self._name == "controller":
            self._out = self._worker.torque(got["state"], got["reference"]).hex()
        else:
            self._out = reference(time).hex()
        return time + 1

    def get_data(self, outputs: Any) -> Any:
        return {"e": {PORTS[self._name]: self._out}}

    def finalize(self) -> None:
        if self._clock is not None:
            self._clock.show()


def main(steps: int) -> None:
    """Run it."""
    program = f"{sys.executable} -m benchmarks.suite.peers.mosaik_chain %(addr)s"
    world = mosaik.World({name: {"cmd": f"{program} {name}"} for name in PORTS})
    entities = {name: world.start(name).M() for name in PORTS}
    world.connect(entities["plant"], entities["controller"], "state")
    world.connect(entities["mission"], entities["controller"], "reference")
    start: Any = {"command": bytes(16).hex()}
    world.connect(
        entities["controller"], entities["plant"], "command", time_shifted=True, initial_data=start
    )
    world.run(until=steps, print_progress=False)


if __name__ == "__main__":
    if len(sys.argv) > 2:
        simulator = Simulator(sys.argv.pop(2))
        mosaik_api_v3.start_simulation(simulator)
    else:
        main(int(sys.argv[1]))
