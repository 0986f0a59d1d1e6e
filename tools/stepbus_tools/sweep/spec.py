"""What a sweep is: declared once, for the command line and for a file, and checked before it runs.

scenario: two_link
vary:
  - controller.params.kp=50:200:7
  - plant.params.gravity~uniform(9.7, 0.2)
samples: 500
"""

import dataclasses
import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.errors import RecordingFailed, ScenarioError
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.override import named_from
from stepbus_participant import Count, Problems, Settings, Whole, read_text, suggest, write_file
from stepbus_participant.parameters import Keys, Place, read, read_yaml
from stepbus_schemas import WiringError
from stepbus_tools.sweep.axes import FAULTS, Axis, Design, Point, Sampling, parse_axis
from stepbus_tools.sweep.bundle import metric_file
from stepbus_tools.sweep.sweep_metrics import BUILTIN

SPEC_FILE = "sweep.json"
_LIKE = "a sweep file must be a map with the keys `scenario` and `vary`"
_NO_FAULT = "none"


class Spec(Settings):
    """The declaration of a sweep."""

    scenario: str
    """A scenario file, relative to the sweep's, a folder, or the name of a built-in one."""
    set: tuple[str, ...] = ()
    """What is the same in all runs: `PATH=VALUE`."""
    vary: tuple[str, ...] = ()
    """The axes: `PATH=VALUES` or `PATH~DISTRIBUTION`."""
    samples: Whole = 0
    """How many values are drawn from each distribution."""
    sampling: Sampling = "random"
    """How they are drawn: independently, or so that they fill the space."""
    seed: Whole = 0
    """What the draws depend on, and the choices of an optimizer."""
    repeats: Count = 1
    """Runs of each point, each with another `seed` of the scenario."""
    metrics: tuple[str, ...] = ()
    """Your own metrics: `FILE.py:FUNCTION`, relative to the sweep's file."""
    optimize: str | None = None
    """The metric that an optimizer makes small; the axes are ranges without a count, lists, or
    `uniform`."""
    maximize: bool = False
    """Make it large instead."""
    trials: Whole = 0
    """How many runs the optimizer has."""
    batch: Count = 4
    """How many of them it asks for at once, however many cores there are."""

    def plain(self) -> dict[str, Any]:
        """Return the sweep as plain data, as a file has it."""
        fields: dict[str, Any] = json.loads(msgspec.json.encode(self))
        return fields


_USUAL = Spec(scenario="")


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A sweep that can run.

    variants: its scenario, and the same with values that name files. design: its runs, which an
    optimizer chooses instead where the sweep has one.
    """

    spec: Spec
    axes: Sequence[Axis]
    design: Design
    variants: Sequence[Scenario]


def plan(scenario: str, options: Mapping[str, Any]) -> Plan:
    """Return the plan of a sweep, given as a scenario or as a sweep's file; nothing starts.

    The scenario is loaded with values of each axis. options: take the place of what the file has.
    Raises ScenarioError with every problem.
    """
    spec, problems = _read(scenario, options)
    parsed = [
        problems.attempt(("vary", number), partial(parse_axis, text))
        for number, text in enumerate(spec.vary)
    ]
    for keys, text in _contradictions(spec, parsed):
        if not problems.has(keys):
            problems.add(keys, text)
    for number, text in enumerate(spec.metrics):
        problems.attempt(("metrics", number), partial(metric_file, text))
    base = problems.attempt((), lambda: load(spec.scenario, spec.set))
    variants = [] if base is None else [base]
    if base is not None:
        parsed = [axis and _in_folder(axis, base.folder) for axis in parsed]
    # With a wrong `set`, the axes are still tried on the scenario as it is.
    if base or (spec.set and Problems().attempt((), partial(load, spec.scenario))):
        overrides = () if base is None else spec.set
        for number, axis in enumerate(parsed):
            if axis is not None:
                above = ("vary", number)
                variants += _variants(spec.scenario, overrides, axis, problems.below(above))
    axes = [_typed(spec, axis) for axis in parsed if axis is not None]
    design: Design | None = Design([])
    if spec.optimize is None and len(axes) == len(parsed):
        design = problems.attempt(
            (),
            lambda: Design(
                axes,
                samples=spec.samples,
                sampling=spec.sampling,
                seed=spec.seed,
                repeats=spec.repeats,
                first_seed=base.seed if base is not None else 0,
            ),
        )
    if design is None or len(problems):
        raise ScenarioError(problems.error().problems)
    return Plan(spec=spec, axes=axes, design=design, variants=variants)


def _in_folder(axis: Axis, folder: Path) -> Axis:
    """Return an axis whose files are relative to the scenario's folder, as in the runs' copies."""
    rows = [dict(zip(axis.paths, row, strict=True)) for row in axis.values]
    values = (tuple(named_from(folder, path, value) for path, value in r.items()) for r in rows)
    return dataclasses.replace(axis, values=tuple(values))


def _read(scenario: str, options: Mapping[str, Any]) -> tuple[Spec, Problems]:
    """Return the declaration of a sweep, and the problems of its values.

    What is wrong is replaced by its default.
    """
    path = Path(scenario)
    if not (path.is_file() and _is_sweep(path)):
        problems = Problems()
        return read(Spec, {"scenario": scenario, **options}, problems), problems
    file = read_yaml(path, _LIKE)
    data = {**file.data, **options}
    places = {at: place for at, place in file.places.items() if at[0] not in options}
    places |= {(key,): Place(file="", line=0) for key in options}
    problems = dataclasses.replace(file, places=places).problems()
    for key in ("scenario", "metrics"):
        if key in file.data and key not in options:
            data[key] = _beside(path.parent, data[key])
    return read(Spec, data, problems), problems


def _contradictions(spec: Spec, axes: Sequence[Axis | None]) -> Iterator[tuple[Keys, str]]:
    """Yield (keys, message) of each contradiction in a sweep; axes: None for an invalid axis."""
    if not axes:
        yield ("vary",), "needs at least one axis, e.g. controller.params.kp=50:200:7"
    if spec.optimize is not None:
        yield from _optimizer_problems(spec, spec.optimize)
    else:
        if spec.trials or spec.maximize:
            yield ("optimize",), "needs the name of a metric, as trials are for an optimizer"
        if spec.batch != _USUAL.batch:
            yield ("batch",), "is only for an optimizer"
        if spec.sampling != _USUAL.sampling and not any(a is None or a.distribution for a in axes):
            yield ("sampling",), "no axis has a distribution to sample"
    for number, axis in enumerate(axes):
        if axis is None:
            continue
        if spec.optimize is None and axis.span is not None:
            text = f"{axis.text}: a range needs a count, e.g. {axis.text}:7; only an optimizer"
            yield ("vary", number), f"{text} takes a range without a count"
        if spec.optimize is not None and (axis.distribution or len(axis.paths) > 1):
            text = "an optimizer takes ranges and lists, such as PATH=50:200"
            yield ("vary", number), f"{axis.text}: {text}"


def _optimizer_problems(spec: Spec, name: str) -> Iterator[tuple[Keys, str]]:
    """Yield (keys, message) of each problem of a sweep that optimises a metric."""
    if not spec.trials:
        text = "an optimizer needs a number of runs in --trials, e.g. 100"
        yield ("trials",), text
    for key in ("samples", "repeats", "sampling"):
        if getattr(spec, key) != getattr(_USUAL, key):
            yield (key,), "the optimizer chooses the runs; remove it"
    # Metrics of the user's own are known later.
    if not (spec.metrics or name in BUILTIN or name.startswith("rmse.")):
        known = ", ".join([*BUILTIN, "rmse.JOINT"])
        text = f"{name}: unknown metric (built-in: {known}; your own: --metric FILE:FUNCTION)"
        yield ("optimize",), f"{text}{suggest(name, BUILTIN)}"


def _typed(spec: Spec, axis: Axis) -> Axis:
    """Return an axis whose span has fractions if its parameter accepts them."""
    if axis.span is None or not axis.span.is_whole:
        return axis
    try:
        load(spec.scenario, [*spec.set, f"{axis.paths[0]}={axis.span.low + 0.5}"])
    except ScenarioError:
        return axis
    return dataclasses.replace(axis, span=dataclasses.replace(axis.span, is_whole=False))


def _variants(
    scenario: str, overrides: Sequence[str], axis: Axis, problems: Problems
) -> Iterator[Scenario]:
    """Yield the scenario with each value that names a file; add the problems of all values."""
    sentences: dict[str, None] = {}
    for values in axis.probes():
        texts, faults = overrides_of(Point(0, dict(zip(axis.paths, values, strict=True))))
        try:
            variant = load(scenario, [*overrides, *texts], faults)
        except ScenarioError as exc:
            shown = (f"{p.path}: {p.message}".removeprefix(": ") for p in exc.problems)
            sentences |= dict.fromkeys(shown)
            continue
        if any(isinstance(value, str) for value in values):
            yield variant
    for sentence in sentences:
        problems.add((), f"{axis.text}: {sentence}")


def overrides_of(point: Point) -> tuple[list[str], Sequence[str]]:
    """Return the settings of a point, as `--set` has them, and its faults."""
    texts = [
        f"{path}={msgspec.json.encode(value).decode()}"
        for path, value in point.values.items()
        if path != FAULTS
    ]
    fault = point.values.get(FAULTS)
    given = fault if isinstance(fault, list) else [fault]
    return texts, [str(one) for one in given if one not in {None, _NO_FAULT}]


def _beside(folder: Path, value: Any) -> Any:
    """Return file names relative to where we are; a name that is no file stays."""
    if isinstance(value, list):
        return [_beside(folder, one) for one in value]
    name = str(value).rpartition(":")[0] if str(value).count(".py:") else str(value)
    return str(folder / str(value)) if (folder / name).exists() else value


def _is_sweep(path: Path) -> bool:
    """Return whether a file is that of a sweep: it names a scenario."""
    try:
        text = read_text(path, errors="replace")
    except OSError:
        # What reads it as a scenario says what is wrong with it.
        return False
    return any(line.startswith(("scenario:", "vary:")) for line in text.splitlines())


def save_spec(folder: Path, spec: Spec, fingerprint: str) -> None:
    """Write a sweep to its folder; raises RecordingFailed where that cannot be."""
    content = {"sweep": spec.plain(), "fingerprint": fingerprint}
    path = folder / SPEC_FILE
    try:
        write_file(path, f"{json.dumps(content, indent=2)}\n".encode())
    except OSError as exc:
        raise RecordingFailed(f"{path} cannot be written: {exc.strerror}") from exc


def load_spec(folder: Path) -> tuple[Spec, str]:
    """Return the sweep of a folder, and the fingerprint of its files.

    Raises WiringError where the folder holds none.
    """
    path = folder / SPEC_FILE
    try:
        content = json.loads(read_text(path))
        return Spec.of(content["sweep"]), str(content["fingerprint"])
    except FileNotFoundError as exc:
        raise WiringError(f"{folder} is not a sweep: it has no {SPEC_FILE}") from exc
    except (OSError, ValueError, KeyError, TypeError) as exc:
        raise WiringError(f"{path} is not a sweep file written by stepbus: {exc}") from exc


def default_name(spec: Spec) -> str:
    """Return a folder's name, the same for the same sweep."""
    stem = re.sub(r"\W+", "_", Path(spec.scenario).with_suffix("").as_posix()).strip("_")
    return f"{stem}-{hashlib.sha256(json.dumps(spec.plain()).encode()).hexdigest()[:8]}"


def differences(old: Spec, new: Spec) -> list[str]:
    """Return the settings in which two sweeps differ."""
    before, now = old.plain(), new.plain()
    return [
        f"{key} was {before[key]!r}, now it is {now[key]!r}"
        for key in now
        if before[key] != now[key]
    ]
