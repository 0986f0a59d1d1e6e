# mypy: ignore-errors
"""The arm as a simulator of mosaik."""

from typing import Any

import arm
import mosaik_api_v3

META = {
    "type": "time-based",
    "models": {"Arm": {"public": True, "params": [], "attrs": ["torque", "position", "velocity"]}},
}


class Plant(mosaik_api_v3.Simulator):
    """One step is 5 ms; the torque that it reads is that of the step before."""

    def __init__(self) -> None:
        super().__init__(META)
        self.arm = arm.Arm()

    def create(self, num: int, model: str, **params: Any) -> list[dict[str, str]]:
        return [{"eid": "arm", "type": model}]

    def step(self, time: int, inputs: Any, max_advance: int) -> int:
        if time > 0:
            (torque,) = inputs["arm"]["torque"].values()
            self.arm.advance(tuple(torque))
        return time + 1

    def get_data(self, outputs: Any) -> Any:
        return {"arm": {"position": self.arm.position, "velocity": self.arm.velocity}}


if __name__ == "__main__":
    mosaik_api_v3.start_simulation(Plant())
