"""What a sweep measures of each run.

The figures that ship are those of joints that follow a reference; your own are a function of the
recording: `metric(recording) -> dict`, or a number.
"""

import importlib.util
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.result import Result
from stepbus_schemas import RunError, error_text
from stepbus_tools.signals import Signal, Tracking, read_tracking, tracking_rmse

Array = NDArray[np.float64]
Metric = Callable[[Recording], Any]
Value = float | int | bool | str | None

_SETTLED_AFTER_S = 2.0
_BAND = 0.02
_REST_SHARE = 0.2
_FULL = 1 - 1e-6
BUILTIN = ("success", "duration", "rmse", "overshoot", "settling", "saturation", "energy")
"""Names of the figures that ship; there is `rmse.JOINT` too."""
UNITS = {"duration": "s", "settling": "s", "energy": "J"}
"""That of an error depends on its joint."""


class MetricFailed(RunError):
    """A user's metric raised, or returned what is no metric."""


def builtin_metrics(result: Result, recording: Recording) -> dict[str, Value]:
    """Return the figures that ship; None where a run has nothing to measure them by.

    success: whether the run finished. duration: simulated [s]. rmse: root mean square of the
    tracking errors of all joints [rad or m], as the summary gives it for each: after 2 s in a run
    that is longer; `rmse.JOINT`: of one. overshoot: largest, as a share of the joint's travel, and
    settling: until all stay within 2 % of it [s], where the reference ends at rest. saturation:
    largest share of time that a joint spends at its effort limit. energy: mechanical work that the
    motors do and take [J].
    """
    tracking = read_tracking(recording)
    errors = tracking_rmse(
        tracking, _SETTLED_AFTER_S if result.simulated_s > _SETTLED_AFTER_S else 0.0
    )
    states = tracking.states.values()
    saturations = [share for state in states if (share := _saturation(state)) is not None]
    steps = [response for joint in tracking.joints if (response := _step_response(tracking, joint))]
    return {
        "success": result.exit_code == 0,
        "duration": result.simulated_s,
        "rmse": math.sqrt(sum(e * e for e in errors.values()) / len(errors)) if errors else None,
        **{f"rmse.{joint}": error for joint, error in errors.items()},
        "overshoot": max((overshoot for overshoot, _ in steps), default=None),
        "settling": max((settled for _, settled in steps), default=None),
        "saturation": max(saturations, default=None),
        "energy": _energy(states),
    }


def _step_response(tracking: Tracking, joint: str) -> tuple[float, float] | None:
    """Return overshoot and settling time of a joint; None where its reference ends in motion."""
    state, reference = tracking.state_of(joint), tracking.reference_of(joint)
    if state is None or reference is None:
        return None
    measured, wanted = state.of("position", joint), reference.of("position", joint)
    if measured is None or wanted is None or not len(measured):
        return None
    end, start = float(wanted[-1]), float(measured[0])
    rests = wanted[int(len(wanted) * (1 - _REST_SHARE)) :]
    travel = abs(end - start)
    if np.any(rests != end) or travel < 1e-6:
        return None
    beyond = (measured - end) * math.copysign(1.0, end - start)
    outside = np.flatnonzero(np.abs(measured - end) > _BAND * travel)
    settled = float(state.t[outside[-1]] - state.t[0]) if len(outside) else 0.0
    return max(0.0, float(np.max(beyond)) / travel), settled


def _saturation(state: Signal) -> float | None:
    effort, limits = state.fields.get("effort"), state.limits.get("effort")
    if effort is None or limits is None or not len(effort):
        return None
    return float(np.max(np.mean(np.abs(effort) >= np.asarray(limits) * _FULL, axis=0)))


def _energy(states: Any) -> float | None:
    total = None
    for state in states:
        effort, velocity = state.fields.get("effort"), state.fields.get("velocity")
        if effort is None or velocity is None or len(state.t) < 2:
            continue
        power = np.sum(np.abs(effort * velocity), axis=1)
        total = (total or 0.0) + float(np.sum(power[1:] * np.diff(state.t)))
    return total


class Metrics(dict[str, float]):
    """The metrics of a run by name, as in a sweep. units: units of those that have one."""

    def __init__(self, values: Mapping[str, float], units: Mapping[str, str]) -> None:
        super().__init__(values)
        self.units = dict(units)

    def __repr__(self) -> str:
        """Return every metric with its unit, in a line."""
        rows = (f"{name} {value:.4g} {self.units.get(name, '')}" for name, value in self.items())
        return f"<Metrics {', '.join(map(str.rstrip, rows))}>"


def result_metrics(result: Result) -> Metrics:
    """Return the metrics that ship of one run, without those that this run has no data for.

    Raises RecordingFailed when its recording cannot be read.
    """
    with Recording(result) as recording:
        measured = builtin_metrics(result, recording)
        known = {
            f"rmse.{joint}": port.description.unit("rad", number)
            for port in recording.of_type("JointState/1")
            for number, joint in enumerate(port.names)
        }
    values = {name: value for name, value in measured.items() if isinstance(value, int | float)}
    units = {name: known.get(name, "rad") for name in values if name.startswith("rmse.")}
    if units:
        units["rmse"] = ", ".join(sorted(set(units.values()), reverse=True))
    return Metrics(values, {name: unit for name, unit in UNITS.items() if name in values} | units)


class UserMetrics:
    """The user's metrics, loaded from files; each of `names` is `file.py:function`.

    folder: where the files are. Raises MetricFailed for a file that cannot be loaded.
    """

    def __init__(self, names: Mapping[str, str], folder: Path) -> None:
        self._functions = {text: _load(folder / path, text) for text, path in names.items()}

    def of(self, recording: Recording) -> tuple[dict[str, Value], list[str]]:
        """Return what all of them measure, and why some have not."""
        values: dict[str, Value] = {}
        errors = []
        for text, function in self._functions.items():
            try:
                values |= _measured(text, function, recording)
            except MetricFailed as exc:
                errors.append(str(exc))
        return values, errors


def _load(path: Path, text: str) -> Metric:
    name, function = f"stepbus_metric_{path.stem}", text.rpartition(":")[2]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise MetricFailed(f"metric {text}: no Python file {path.name}")
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.parent))
    try:
        spec.loader.exec_module(module)
    except Exception as exc:  # whatever a user's file raises is its own
        raise MetricFailed(f"metric {text}: {path.name} raises {error_text(exc)}") from exc
    finally:
        sys.path.remove(str(path.parent))
    loaded: Any = getattr(module, function, None)
    if not callable(loaded):
        raise MetricFailed(f"metric {text}: {path.name} has no function {function!r}")
    metric: Metric = loaded
    return metric


def _measured(text: str, function: Metric, recording: Recording) -> dict[str, Value]:
    try:
        given = function(recording)
    except Exception as exc:
        raise MetricFailed(f"{text} raised {error_text(exc)}") from exc
    named = given if isinstance(given, Mapping) else {text.rpartition(":")[2]: given}
    values: dict[str, Value] = {}
    for name, value in named.items():
        plain = value.item() if hasattr(value, "item") and not getattr(value, "ndim", 0) else value
        if not (plain is None or isinstance(plain, bool | int | float | str)):
            what = f"{name} is {type(plain).__name__}, not a number, string or boolean"
            raise MetricFailed(f"{text}: {what}")
        values[str(name)] = plain
    return values
