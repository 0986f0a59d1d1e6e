"""FMPy, in a process of its own: FMUs of two libraries in one would share what they must not."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import fmpy
import numpy as np
from fmpy.simulation import instantiate_fmu
from fmpy.validation import validate_fmu

STEP, STEPS = 0.005, 100


def apart(calls):
    """Return what functions of this module return in a new process. calls: name → it, arguments."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_results, calls).result(timeout=240)


def _results(calls):
    return {name: function(*args) for name, (function, *args) in calls.items()}


class Fmu:
    """One instance, in initialization mode."""

    def __init__(self, path, starts=()):
        folder = fmpy.extract(str(path))
        description = fmpy.read_model_description(folder)
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.lines = []
        self.fmu = fmu = instantiate_fmu(
            folder, description, "CoSimulation", debug_logging=True, logger=self.log
        )
        is_3 = description.fmiVersion.startswith("3")
        self._set, self._get = (
            (fmu.setFloat64, fmu.getFloat64) if is_3 else (fmu.setReal, fmu.getReal)
        )
        if not is_3:
            fmu.setupExperiment()
        fmu.enterInitializationMode()
        self.set(dict(starts))

    def log(self, *words):
        self.lines.append(words[-1].decode())

    def set(self, values):
        self._set([self.references[name] for name in values], list(values.values()))

    def get(self, names):
        return list(self._get([self.references[name] for name in names]))

    def step(self, index, size=STEP):
        return self.fmu.doStep(index * STEP, size)


def problems(paths):
    return [problem for path in paths for problem in validate_fmu(str(path))]


def variables(paths):
    """Return for each FMU: variable → causality, type, unit, start value, description."""
    return [
        {v.name: (v.causality, v.type, v.unit, v.start, v.description) for v in one.modelVariables}
        for one in map(fmpy.read_model_description, map(str, paths))
    ]


def simulated(path, rows, names):
    """Return the columns of some outputs by FMPy's own loop. rows: name → inputs, a row a step."""
    count = len(next(iter(rows.values()), range(STEPS)))
    signals = np.zeros(count, dtype=[("time", float), *((name, float) for name in rows)])
    signals["time"] = np.arange(count) * STEP
    for name, values in rows.items():
        signals[name] = values
    result = fmpy.simulate_fmu(
        str(path), stop_time=count * STEP, output_interval=STEP, input=signals
    )
    return np.stack([result[name] for name in names], 1)


def coupled(controller, rest, joints, references):
    """Return the joint positions of two FMUs, each of which gets what the other has published."""
    first, second = Fmu(controller), Fmu(rest)
    first.fmu.exitInitializationMode()
    second.fmu.exitInitializationMode()
    positions, values = [], [f"command.values[{i}]" for i in (1, 2)]
    for index in range(STEPS):
        measured = second.get([f"plant.{name}" for name in joints])
        positions.append(measured[:2])
        first.set(dict(zip(joints, measured, strict=True)))
        wanted = second.get([f"mission.{name}" for name in references])
        first.set(dict(zip(references, wanted, strict=True)))
        first.step(index)
        second.set({f"controller.{n}": v for n, v in zip(values, first.get(values), strict=True)})
        second.step(index)
    return positions


def failing(path, starts, steps, inputs):
    """Return the lines of the log and how it ended: the start, or one of the steps."""
    fmu = Fmu(path, starts)
    try:
        fmu.fmu.exitInitializationMode()
        fmu.set(inputs)
        for step in steps:
            if (ended := fmu.step(*step)) and ended[1]:
                return fmu.lines, "terminateSimulation"
    except fmpy.fmi1.FMICallException as exc:
        return fmu.lines, str(exc)
