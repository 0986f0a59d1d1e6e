"""What is wrong with a sweep, all of it, before anything starts."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from stepbus_orchestrator.errors import ScenarioError, argument
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_participant import Problems, suggest
from stepbus_schemas import WiringError
from stepbus_tools.sweep.axes import FAULTS, Axis, parse_axis
from stepbus_tools.sweep.content import metric_file
from stepbus_tools.sweep.design import Design, Point
from stepbus_tools.sweep.sweep_metrics import BUILTIN
from stepbus_tools.sweep.trial import overrides_of

from .spec import Spec, draft

_MOST_CHECKED = 200


@dataclass(frozen=True)
class Checked:
    """A sweep that can run: its points, its scenario, and that with values which name files."""

    design: Design
    scenario: Scenario
    variants: Sequence[Scenario]


def find_spec(scenario: str, options: Mapping[str, Any]) -> Spec:
    """Return the sweep of a scenario, or that of a sweep's file, some of it replaced.

    Raises SettingsError with every problem, those of `check` included.
    """
    spec, problems = draft(scenario, options)
    if len(problems):
        _survey(spec, problems)
        problems.refuse()
    return spec


def check(spec: Spec) -> Checked:
    """Load the scenario with the values of each axis; nothing starts.

    Raises ScenarioError with every problem.
    """
    problems = Problems()
    checked = _survey(spec, problems)
    if checked is None:
        raise ScenarioError(problems.error().problems)
    return checked


def _survey(spec: Spec, problems: Problems) -> Checked | None:
    """Return a sweep that can run; None where something is wrong, which is added."""
    before = len(problems)
    _check_metric(spec, problems)
    for index, text in enumerate(spec.metrics):
        problems.attempt(("metrics", index), partial(metric_file, text))
    axes = [(n, axis) for n, text in enumerate(spec.vary) if (axis := _axis(text)) is not None]
    design = Design([])
    if spec.optimize is None and len(axes) == len(spec.vary):
        design = problems.attempt((), spec.design) or design
    base = problems.attempt((), lambda: load(spec.scenario, spec.set))
    # With a wrong `set`, the axes are still tried on the scenario as it is.
    overrides = () if base is None else spec.set
    variants = [] if base is None else [base]
    if base is not None or (spec.set and _loads(spec.scenario)):
        for number, axis in axes:
            variants += _variants(spec.scenario, overrides, number, axis, problems)
    if base is None or len(problems) > before:
        return None
    if spec.optimize is None:
        design = spec.design(base.seed)
    return Checked(design, base, variants)


def _axis(text: str) -> Axis | None:
    try:
        return parse_axis(text)
    except WiringError:
        # Who drafts the sweep tells it.
        return None


def _loads(scenario: str) -> bool:
    try:
        load(scenario)
    except ScenarioError:
        return False
    return True


def _variants(
    scenario: str, overrides: Sequence[str], number: int, axis: Axis, problems: Problems
) -> Iterator[Scenario]:
    """Yield the scenario with values of an axis that name files; add what is wrong with others."""
    told: dict[str, None] = {}
    for point in _probes(axis):
        texts, faults = overrides_of(point)
        try:
            variant = load(scenario, [*overrides, *texts], faults)
        except ScenarioError as exc:
            told |= dict.fromkeys(f"{p.path}: {p.message}".removeprefix(": ") for p in exc.problems)
            continue
        if any(isinstance(value, str) for value in point.values.values()):
            yield variant
    for text in told:
        problems.add(("vary", number), f"{axis.text}: {text}")


def _check_metric(spec: Spec, problems: Problems) -> None:
    """Add a metric that no run can have; those of your own are known later."""
    name = spec.optimize
    if name is None or spec.metrics or name in BUILTIN or name.startswith("rmse."):
        return
    known = ", ".join([*BUILTIN, "rmse.JOINT"])
    text = f"{name}: there is no such metric{suggest(name, BUILTIN)}; there are {known}, "
    more = argument("--metric", "metrics", "FILE:FUNCTION")
    problems.add(("optimize",), f"{text}and your own with {more}")


def _probes(axis: Axis) -> Iterator[Point]:
    """Yield points in which an axis has one of its values: all of them where they are few."""
    for values in _some(axis):
        yield Point(0, dict(zip(axis.paths, values, strict=True)))


def _some(axis: Axis) -> Sequence[tuple[object, ...]]:
    if axis.span is not None:
        ends = (axis.span.low, axis.span.high)
        return [(int(end) if axis.span.is_whole else end,) for end in ends]
    if axis.distribution is not None:
        return [(value,) for value in axis.distribution.probes()]
    texts = {row for row in axis.values if all(isinstance(value, str) for value in row)}
    if texts or axis.paths == (FAULTS,):
        return axis.values[:_MOST_CHECKED]
    return [axis.values[0], axis.values[-1]]
