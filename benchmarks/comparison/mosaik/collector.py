# mypy: ignore-errors
"""A collector for mosaik: writes what it is connected to into a CSV file, one row a step."""

from pathlib import Path
from typing import Any

import mosaik_api_v3

META = {
    "type": "time-based",
    "models": {"Collector": {"public": True, "any_inputs": True, "params": [], "attrs": []}},
}


class Collector(mosaik_api_v3.Simulator):
    """Runs in the process of the scenario."""

    def __init__(self) -> None:
        super().__init__(META)
        self.file = Path("recording.csv").open("w")  # noqa: SIM115  closed by finalize

    def create(self, num: int, model: str, **params: Any) -> list[dict[str, str]]:
        return [{"eid": "collector", "type": model}]

    def step(self, time: int, inputs: Any, max_advance: int) -> int:
        data = inputs["collector"]
        cells = [x for name in sorted(data) for values in data[name].values() for x in values]
        self.file.write(",".join(map(str, [time, *cells])) + "\n")
        return time + 1

    def finalize(self) -> None:
        self.file.close()
