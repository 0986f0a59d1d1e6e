"""What is wrong with a sweep, all of it, before anything starts."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from stepbus_orchestrator.scenario import Scenario, ScenarioError, load
from stepbus_participant import suggest
from stepbus_participant.parameters import Problem
from stepbus_schemas import WiringError

from .space import FAULTS, Axis, Design, Point
from .spec import Spec
from .work import BUILTIN, overrides_of

_MOST_CHECKED = 200


@dataclass(frozen=True)
class Checked:
    """A sweep that can run: its points, its scenario, and that with values which name files."""

    design: Design
    scenario: Scenario
    variants: Sequence[Scenario]


def check(spec: Spec) -> Checked:
    """Load the scenario with the values of each axis; nothing starts.

    Raises ScenarioError with every problem, WiringError for axes that do not go together.
    """
    _check_metric(spec)
    base = load(spec.scenario, spec.set)
    problems: dict[str, Problem] = {}
    variants = [base]
    for point in _probes(spec.axes()):
        texts, faults = overrides_of(point)
        try:
            variant = load(spec.scenario, [*spec.set, *texts], faults)
        except ScenarioError as exc:
            problems |= {problem.message: problem for problem in exc.problems}
            continue
        if any(isinstance(value, str) for value in point.values.values()):
            variants.append(variant)
    if problems:
        raise ScenarioError(problems.values())
    design = spec.design(base.seed) if spec.optimize is None else Design([])
    return Checked(design, base, variants)


def _check_metric(spec: Spec) -> None:
    """Raise WiringError for a metric that no run can have; those of your own are known later."""
    name = spec.optimize
    if name is None or spec.metrics or name in BUILTIN or name.startswith("rmse."):
        return
    known = ", ".join([*BUILTIN, "rmse.JOINT"])
    raise WiringError(
        f"--optimize {name}: there is no such metric{suggest(name, BUILTIN)}; there are {known}, "
        "and your own with --metric FILE:FUNCTION"
    )


def _probes(axes: Iterable[Axis]) -> Iterator[Point]:
    """Yield points in which one axis has one of its values: all of them where they are few."""
    for axis in axes:
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
