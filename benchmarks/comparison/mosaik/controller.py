# mypy: ignore-errors
"""The PD controller as a simulator of mosaik."""

from typing import Any

import arm
import mosaik_api_v3

META = {
    "type": "time-based",
    "models": {"PD": {"public": True, "params": [], "attrs": ["position", "velocity", "torque"]}},
}


class Controller(mosaik_api_v3.Simulator):
    """Answers each state with a torque."""

    def __init__(self) -> None:
        super().__init__(META)
        self.torque = (0.0, 0.0)

    def create(self, num: int, model: str, **params: Any) -> list[dict[str, str]]:
        return [{"eid": "pd", "type": model}]

    def step(self, time: int, inputs: Any, max_advance: int) -> int:
        (position,) = inputs["pd"]["position"].values()
        (velocity,) = inputs["pd"]["velocity"].values()
        self.torque = arm.control(time, tuple(position), tuple(velocity))
        return time + 1

    def get_data(self, outputs: Any) -> Any:
        return {"pd": {"torque": self.torque}}


if __name__ == "__main__":
    mosaik_api_v3.start_simulation(Controller())
