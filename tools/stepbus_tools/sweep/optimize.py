"""An optimizer chooses the points of a sweep: Optuna, asked and told in batches.

A batch has the same size whatever the number of cores, and is told in order: the same seed gives
the same sequence everywhere.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from stepbus_orchestrator.errors import argument
from stepbus_participant import need, suggest
from stepbus_schemas import WiringError
from stepbus_tools.sweep.axes import Axis
from stepbus_tools.sweep.design import Point
from stepbus_tools.sweep.trial import Row

from .spec import Spec


class Optimizer:
    """Asks Optuna for points, and tells it what came of them."""

    def __init__(self, spec: Spec) -> None:
        (optuna,) = need(argument("--optimize"), "optuna")
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        sampler = optuna.samplers.TPESampler(seed=spec.seed)
        direction = "maximize" if spec.maximize else "minimize"
        self._study = optuna.create_study(sampler=sampler, direction=direction)
        self._failed = optuna.trial.TrialState.FAIL
        self._spec = spec
        self._asked: dict[int, Any] = {}
        self.paths = [path for axis in spec.axes() for path in axis.paths]

    def __len__(self) -> int:
        """Return the number of runs."""
        return self._spec.trials

    def batches(self) -> Iterator[list[Point]]:
        """Yield the points of one batch after the other; tell the rows before the next."""
        axes = self._spec.axes()
        for first in range(0, len(self), self._spec.batch):
            last = min(first + self._spec.batch, len(self))
            yield [self._ask(number, axes) for number in range(first, last)]

    def refuse_unmeasured(self, rows: Sequence[Row]) -> None:
        """Raise WiringError where runs that finished have no number to optimise."""
        finished = [row for row in rows if row.exit_code == 0]
        if not finished or any(self.value(row) is not None for row in finished):
            return
        name, measured = str(self._spec.optimize), finished[0].metrics
        if name in measured:
            why = f"is {measured[name]!r} in run {finished[0].run}, which is no number"
        else:
            known = ", ".join(measured)
            why = f"is no metric of these runs{suggest(name, measured)}; they have {known}"
        raise WiringError(
            f"{argument('--optimize')} {name}: it {why}: there is nothing to optimise"
        )

    def _ask(self, number: int, axes: Sequence[Axis]) -> Point:
        trial = self._asked[number] = self._study.ask()
        return Point(number, {axis.paths[0]: _suggest(trial, axis) for axis in axes})

    def tell(self, rows: Sequence[Row]) -> None:
        """Tell what came of a batch; a run without the metric is a failed one."""
        for row in sorted(rows, key=lambda row: row.run):
            value = self.value(row)
            trial = self._asked.pop(row.run)
            if value is None:
                self._study.tell(trial, state=self._failed)
            else:
                self._study.tell(trial, value)

    def value(self, row: Row) -> float | None:
        """Return the metric of a run; None where it has none."""
        value = row.metrics.get(str(self._spec.optimize)) if row.exit_code == 0 else None
        is_number = isinstance(value, int | float) and value == value  # noqa: PLR0124  (not NaN)
        return float(value) if is_number and value is not None else None


def _suggest(trial: Any, axis: Axis) -> Any:
    path, span = axis.paths[0], axis.span
    if span is None:
        index = trial.suggest_categorical(path, range(len(axis.values)))
        return axis.values[index][0]
    if span.is_whole:
        return trial.suggest_int(path, int(span.low), int(span.high), log=span.is_log)
    return trial.suggest_float(path, span.low, span.high, log=span.is_log)
