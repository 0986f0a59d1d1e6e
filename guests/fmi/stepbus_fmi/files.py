"""Files that stand for a scenario, or for a participant: an FMU, and a system of them (SSP)."""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from stepbus_participant import find_file, format_duration

from .model import Model, number, read_model

PORTS = (
    ("out", float, "Scalars/1"),
    ("out_integers", int, "Integers/1"),
    ("out_booleans", bool, "Booleans/1"),
    ("out_texts", str, "Texts/1"),
    ("out_binaries", bytes, "Binaries/1"),
)
"""Output port, what its values are, and its type."""
_STEP_S = 0.01
_SETTABLE = ("structuralParameter", "parameter", "input")
_SHOWN = (*_SETTABLE, "calculatedParameter", "output")
_CAN = {
    "hasEventMode": "has an event mode",
    "mightReturnEarlyFromDoStep": "may return early from a step",
    "canInterpolateInputs": "can interpolate inputs",
    "canHandleVariableCommunicationStepSize": "takes steps of any size",
    "canSerializeFMUstate": "can save its state",
    "needsExecutionTool": "needs the tool that exported it",
}


def scenario_name(text: str) -> str:
    """Return a text as the name of a scenario or a participant."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", text).lstrip("_-")[:64] or "fmu"


def fmu_scenario(path: Path) -> dict[str, Any]:
    """Return the scenario of an FMU alone: its default experiment, all its outputs.

    Raises WiringError for an FMU that cannot take part.
    """
    model = read_model(path)
    name = scenario_name(str(model.description.modelName or path.stem))
    return scenario(name, {name: participant(model, path.name)}, [model])


def fmu_starter(path: Path, name: str) -> dict[str, bytes]:
    """Return file → content of a folder with a scenario of an FMU, for the user to go on with."""
    model, made = read_model(path), fmu_scenario(path)
    rows = [f"name: {name}", f"step: {made['step']}", f"duration: {made['duration']}"]
    rows += ["participants:", f"  {next(iter(made['participants']))}:"]
    rows += [f"    participant: {json.dumps(path.name)}"]
    rows += ["    # inputs: {in: PARTICIPANT.OUTPUT}"]
    rows += ["    # params: {inputs: {VARIABLE: in.NAME}, start: {VARIABLE: VALUE}}"]
    rows += [f"    # {line}" for line in _variables(model, *_SETTABLE)]
    return {"scenario.yaml": "\n".join((*rows, "")).encode(), path.name: path.read_bytes()}


def participant(model: Model, fmu: str, inside: str = "") -> dict[str, Any]:
    """Return the participant of an FMU: as a plant, it publishes the state before it steps."""
    params = {"fmu": fmu, "inside": inside, "start_time": _experiment(model, "startTime")}
    return {
        "participant": "stepbus_fmi:Fmu",
        "publishes": "first",
        "outputs": {port: type_ for port, kind, type_ in PORTS if model.of("output", kind)},
        "params": {key: value for key, value in params.items() if value},
    }


def scenario(
    name: str, participants: Mapping[str, Any], models: list[Model], stop_s: float | None = None
) -> dict[str, Any]:
    """Return a scenario of FMUs: the shortest step that one wishes, and that all can take.

    stop_s: its length [s]; None: that of the longest default experiment.
    """
    # An FMU gets nowhere in a step that is shorter than its own ones.
    own = (model.internal_step for model in models)
    step_s = max(min(filter(None, map(_step, models)), default=_STEP_S), *own)
    step_ns = max(1, round(step_s * 1e9))
    if stop_s is None:
        span = max(_experiment(m, "stopTime") - _experiment(m, "startTime") for m in models)
        stop_s = span if span > 0 else 1.0
    steps = max(1, round(stop_s * 1e9 / step_ns))
    return {
        "name": name,
        "step": format_duration(step_ns),
        "duration": format_duration(steps * step_ns),
        "types": ["stepbus_fmi.messages"],
        "participants": dict(participants),
    }


def _experiment(model: Model, key: str) -> float:
    """Return a number of the default experiment; 0 where it says none."""
    text = getattr(model.description.defaultExperiment, key, None)
    return number(f"{model.file}: {key}", text)


def _step(model: Model) -> float:
    """Return the step that an FMU wishes, or a hundredth of its experiment [s]; 0: none."""
    wished = _experiment(model, "stepSize") or model.internal_step
    return wished or _experiment(model, "stopTime") / 100


def ssp_scenario(path: Path) -> dict[str, Any]:
    """Return the scenario of a system of FMUs; raises WiringError for one that cannot run."""
    from .ssp import system_scenario  # noqa: PLC0415  (most scenarios have none)

    return system_scenario(path)


def about(spec: Any, scenario: Any) -> list[str]:
    """Return what `stepbus describe` says of an FMU: what it can do, its variables, its delays."""
    params = spec.params
    path = find_file(params["fmu"], scenario.folder)
    model = read_model(path, params.get("inside", ""), params.get("start"))
    said, fixed = model.description, model.can.fixedInternalStepSize
    by = f", by {said.generationTool}" if said.generationTool else ""
    can = [text for flag, text in _CAN.items() if getattr(model.can, flag)]
    can += [f"internal step {fixed} s"] if fixed else []
    lines = [f"FMI {said.fmiVersion}: {said.modelName}{by}"]
    lines += [said.description] if said.description else []
    lines += ["; ".join(can) or "has none of the optional capabilities"]
    lines += _variables(model, *_SHOWN)
    h = spec.every * scenario.step_ns / 1e9
    when = f"is set at t; the outputs of t + {h:g} s follow at once (`publishes: last`)"
    if spec.publishes == "first":
        when = (
            f"is set at t and shows in the outputs at t + {h:g} s: one step of delay, since the "
            "FMU publishes its state before it takes the inputs (`publishes: first`)"
        )
    for port, source in spec.inputs.items():
        old = f"{source.delay} steps before" if source.delay else "the same step"
        lines.append(f"{port} ← {source.from_}: the value of {old} {when}")
    return [f"  {line}" for line in lines]


def _variables(model: Model, *causalities: str) -> Iterator[str]:
    """Yield a line about each variable of some causalities."""
    for item in model.variables.values():
        if item.causality in causalities:
            size = f" ({' × '.join(map(str, item.shape))})" if item.shape else ""
            start = "" if item.start is None else f" = {item.start}"
            unit = f" [{item.unit}]" if item.unit else ""
            text = f": {item.description}" if item.description else ""
            line = f"{item.causality:9} {item.name}{size}: {item.variability} {item.type}"
            yield " ".join(f"{line}{start}{unit}{text}".splitlines())
