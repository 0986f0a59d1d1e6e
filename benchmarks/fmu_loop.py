"""Steps of one FMU per second: `python -m benchmarks.fmu_loop model.fmu [STEPS] [ROUNDS]`.

stepbus in one process and with a process for the FMU, recording on, beside what steps the same FMU
and as many times: FMPy's `simulate_fmu`, a plain loop of FMPy's calls, and libcosim where
libcosimpy is installed (FMI 2.0). All in turns; start-up does not count.
"""

import statistics
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from typing import Any

import fmpy

import stepbus

H = 0.01


def by_stepbus(fmu: Path, steps: int, *, in_process: bool) -> float:
    """Return the wall time of a run [s]."""
    length = {"step": "10ms", "duration": f"{steps * 10}ms"}
    scenario = {"name": "loop", **length, "participants": {"fmu": {"participant": str(fmu)}}}
    with tempfile.TemporaryDirectory() as folder:
        result = stepbus.run(scenario, out=f"{folder}/run", in_process=in_process)
        return result.check().wall_s


def by_simulate_fmu(fmu: Path, steps: int) -> float:
    """Return the wall time of FMPy's loop, which records the outputs in memory [s]."""
    times: list[float] = []

    def note(_time: float, _recorder: Any) -> bool:
        times.append(perf_counter())
        return True

    fmpy.simulate_fmu(
        str(fmu), stop_time=steps * H, step_size=H, output_interval=H,
        fmi_type="CoSimulation", step_finished=note,
    )  # fmt: skip
    return times[-1] - times[0]


def by_calls(fmu: Path, steps: int) -> float:
    """Return the wall time of a loop of doStep and get [s]."""
    model = fmpy.read_model_description(fmu)
    instance = fmpy.instantiate_fmu(fmpy.extract(fmu), model, "CoSimulation")
    if model.fmiVersion == "2.0":
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
    else:
        instance.enterInitializationMode(startTime=0.0)
    instance.exitInitializationMode()
    get = instance.getReal if model.fmiVersion == "2.0" else instance.getFloat64
    outputs = [v.valueReference for v in model.modelVariables if v.causality == "output"]
    rows = []
    began = perf_counter()
    for step in range(steps):
        instance.doStep(step * H, H)
        rows.append(get(outputs))
    return perf_counter() - began


def by_libcosim(fmu: Path, steps: int) -> float:
    """Return the wall time of libcosim, with an observer that keeps the values [s]."""
    from libcosimpy.CosimExecution import CosimExecution  # noqa: PLC0415
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level  # noqa: PLC0415
    from libcosimpy.CosimObserver import CosimObserver  # noqa: PLC0415
    from libcosimpy.CosimSlave import CosimLocalSlave  # noqa: PLC0415

    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_step_size(round(H * 1e9))
    execution.add_local_slave(CosimLocalSlave(str(fmu), "fmu"))
    execution.add_observer(CosimObserver.create_last_value())
    began = perf_counter()
    execution.step(steps)
    return perf_counter() - began


def main(fmu: str, steps: str = "20000", rounds: str = "5") -> None:
    """Print the median of each, and its ratio to FMPy's loop."""
    ways: dict[str, Callable[[], float]] = {
        "FMPy, simulate_fmu": lambda: by_simulate_fmu(path, count),
        "FMPy, plain loop": lambda: by_calls(path, count),
        "stepbus, one process": lambda: by_stepbus(path, count, in_process=True),
        "stepbus, processes": lambda: by_stepbus(path, count, in_process=False),
    }
    path, count = Path(fmu).absolute(), int(steps)
    if fmpy.read_model_description(path).fmiVersion == "2.0":
        ways["libcosim"] = lambda: by_libcosim(path, count)
    speeds: dict[str, list[float]] = {}
    for _ in range(int(rounds)):
        for name, way in ways.items():
            with suppress(ImportError):
                speeds.setdefault(name, []).append(count / way())
    base = statistics.median(speeds["FMPy, simulate_fmu"])
    for name, rows in speeds.items():
        median = statistics.median(rows)
        spread = f"({min(rows):.0f} to {max(rows):.0f})"
        print(f"{name:22} {median:9.0f} steps/s  {median / base:5.2f}  {spread}")


if __name__ == "__main__":
    main(*sys.argv[1:])
