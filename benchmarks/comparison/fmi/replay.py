# mypy: ignore-errors
"""FMPy feeds the recorded inputs of the controller to its FMU, and compares its outputs."""

import sys
from pathlib import Path

import arm
import numpy as np
from fmpy import simulate_fmu

INPUTS, OUTPUTS = ["q1", "q2", "v1", "v2"], ["torque1", "torque2"]


def main(fmu: str, logs: str) -> None:
    """Print the number of steps and the largest difference."""
    file = next(Path(logs).glob("controller_*.csv"))
    rows = np.genfromtxt(file, delimiter=",", names=True)
    # The inputs in row k are those with which step k was computed, which began at row k - 1.
    inputs = np.zeros(len(rows) - 1, dtype=[("time", float), *((name, float) for name in INPUTS)])
    inputs["time"] = rows["Time"][:-1]
    for name in INPUTS:
        inputs[name] = rows[name][1:]
    again = simulate_fmu(
        fmu, stop_time=arm.STEPS * arm.STEP_S, step_size=arm.STEP_S, output_interval=arm.STEP_S,
        input=inputs, output=OUTPUTS,
    )  # fmt: skip
    difference = max(np.abs(again[name] - rows[name]).max() for name in OUTPUTS)
    print(f"{len(again)} rows, largest difference {difference:.3g}")


if __name__ == "__main__":
    main(*sys.argv[1:])
