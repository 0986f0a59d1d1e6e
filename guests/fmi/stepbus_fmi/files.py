"""Files that stand for a scenario, or for a participant: an FMU, and a system of them (SSP)."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stepbus_participant import find_file, format_duration
from stepbus_schemas import WiringError

from .model import Model, capabilities, read_model

PORTS = (
    ("out", float, "Scalars/1"),
    ("out_integers", int, "Integers/1"),
    ("out_booleans", bool, "Booleans/1"),
    ("out_texts", str, "Texts/1"),
    ("out_binaries", bytes, "Binaries/1"),
)
_STEP_NS = 10_000_000


def port_of(kind: type) -> tuple[str, str]:
    """Return the output port of the values of a kind, and its type."""
    return next((port, type_) for port, of, type_ in PORTS if of is kind)


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
    inputs = model.of("input")
    parameters = [*model.of("structuralParameter"), *model.of("parameter")]
    rows += ["    # inputs:", "    #   in: PARTICIPANT.OUTPUT"] if inputs else []
    rows += ["    # params:"] if inputs or parameters else []
    for key, items in (("inputs", inputs), ("start", parameters)):
        rows += [f"    #   {key}:"] if items else []
        for item in items:
            start = f"[{', '.join((item.start or '').split())}]" if item.shape else item.start
            value = "in.NAME" if key == "inputs" else start
            unit = f" [{item.unit}]" if item.unit else ""
            text = " ".join(item.description.split()) + unit
            row = f"    #     {json.dumps(item.name)}: {value}    # {text}"
            rows.append(row.rstrip(" #"))
    return {"scenario.yaml": "\n".join((*rows, "")).encode(), path.name: path.read_bytes()}


def participant(model: Model, fmu: str, inside: str = "") -> dict[str, Any]:
    """Return the participant of an FMU: as a plant, it publishes the state before it steps."""
    outputs = {port: type_ for port, kind, type_ in PORTS if model.of("output", kind)}
    start = _number(model, "startTime") or 0.0
    more: dict[str, Any] = {"inside": inside} if inside else {}
    more |= {"start_time": start} if start else {}
    return {
        "participant": "stepbus_fmi:Fmu",
        "publishes": "first",
        "outputs": outputs,
        "params": {"fmu": fmu, **more},
    }


def scenario(
    name: str,
    participants: Mapping[str, Any],
    models: list[Model],
    step_s: float | None = None,
    stop_s: float | None = None,
) -> dict[str, Any]:
    """Return a scenario of FMUs: the shortest step that one wishes, and that all can take."""
    if step_s is None:
        wished = [size for model in models if (size := _step(model))]
        # An FMU gets nowhere in a step that is shorter than its own ones.
        own = (model.internal_step for model in models)
        step_s = max(min(wished, default=_STEP_NS / 1e9), *own)
    step_ns = max(1, round(step_s * 1e9))
    if stop_s is None:
        spans = (_number(m, "stopTime") - (_number(m, "startTime") or 0.0) for m in models
                 if _number(m, "stopTime") is not None)  # fmt: skip
        stop_s = max(spans, default=1.0)
    steps = max(1, round(stop_s * 1e9 / step_ns))
    return {
        "name": name,
        "step": format_duration(step_ns),
        "duration": format_duration(steps * step_ns),
        "types": ["stepbus_fmi.messages"],
        "participants": dict(participants),
    }


def _number(model: Model, key: str) -> Any:
    """Return a number of the default experiment; None where it says none."""
    experiment = model.description.defaultExperiment
    text = getattr(experiment, key, None) if experiment is not None else None
    try:
        return None if text is None else float(text)
    except ValueError as exc:
        raise WiringError(f"{model.file}: {key} is {text!r}, no number") from exc


def _step(model: Model) -> float:
    """Return the step that an FMU wishes, or a hundredth of its experiment [s]; 0: none."""
    wished = _number(model, "stepSize") or model.internal_step
    return wished or (_number(model, "stopTime") or 0.0) / 100


def ssp_scenario(path: Path) -> dict[str, Any]:
    """Return the scenario of a system of FMUs; raises WiringError for one that cannot run."""
    from .ssp import system_scenario  # noqa: PLC0415  (most scenarios have none)

    made: dict[str, Any] = system_scenario(path)
    return made


def about(spec: Any, scenario: Any) -> list[str]:
    """Return what `stepbus describe` says of an FMU: what it can do, its variables, its delays."""
    params = spec.params
    path = find_file(params["fmu"], scenario.folder)
    model = read_model(path, params.get("inside", ""), params.get("start"))
    said = model.description
    by = f", by {said.generationTool}" if said.generationTool else ""
    lines = [f"  FMI {said.fmiVersion}: {said.modelName}{by}"]
    lines += [f"  {said.description}"] if said.description else []
    lines += [f"  {'; '.join(capabilities(model)) or 'has none of the optional capabilities'}"]
    for item in model.variables.values():
        if item.causality not in ("local", "independent"):
            size = f" ({' × '.join(map(str, item.shape))})" if item.shape else ""
            unit = f" [{item.unit}]" if item.unit else ""
            start = "" if item.start is None else f" = {item.start}"
            text = f": {item.description}" if item.description else ""
            lines.append(
                f"  {item.causality:9} {item.name}{size}: {item.variability} {item.type_name}"
                f"{start}{unit}{text}"
            )
    h = spec.every * scenario.step_ns / 1e9
    for port, source in spec.inputs.items():
        lines.append(f"  {port} ← {source.from_}: {_when(spec, source.delay, h)}")
    return lines


def _when(spec: Any, delay: int, h: float) -> str:
    """Return when an output shows a value that an input has taken, and why."""
    at = f"the value of {delay} steps before" if delay else "the value of the same step"
    if spec.publishes == "first":
        return (
            f"{at} is set at t and shows in the outputs at t + {h:g} s: one step of delay, since "
            "the FMU publishes its state before it takes the inputs (`publishes: first`)"
        )
    return f"{at} is set at t; the outputs of t + {h:g} s follow at once (`publishes: last`)"
