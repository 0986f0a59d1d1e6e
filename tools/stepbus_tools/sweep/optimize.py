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
from stepbus_tools.sweep.rows import ResultRow
from stepbus_tools.sweep.spec import Plan


class Optimizer:
    """Asks Optuna for points, and tells it what came of them."""

    def __init__(self, plan: Plan) -> None:
        (optuna,) = need(argument("--optimize"), "optuna")
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        spec = plan.spec
        self._study = optuna.create_study(
            sampler=optuna.samplers.TPESampler(seed=spec.seed),
            direction="maximize" if spec.maximize else "minimize",
        )
        self._failed = optuna.trial.TrialState.FAIL
        self._metric = str(spec.optimize)
        self._trials, self._batch, self._axes = spec.trials, spec.batch, plan.axes
        self._asked: dict[int, Any] = {}
        self.paths = [path for axis in plan.axes for path in axis.paths]

    def __len__(self) -> int:
        """Return the number of runs."""
        return self._trials

    def batches(self) -> Iterator[list[Point]]:
        """Yield the points of one batch after the other; tell the rows before the next."""
        for first in range(0, self._trials, self._batch):
            last = min(first + self._batch, self._trials)
            yield [self._ask(number) for number in range(first, last)]

    def _ask(self, number: int) -> Point:
        trial = self._asked[number] = self._study.ask()
        return Point(number, {axis.paths[0]: _suggest(trial, axis) for axis in self._axes})

    def tell(self, rows: Sequence[ResultRow]) -> None:
        """Tell what came of a batch; a run without the metric is a failed one.

        Raises WiringError where runs that finished have no number to optimise.
        """
        finished = [row for row in rows if row.exit_code == 0]
        if finished and all(self._value(row) is None for row in finished):
            measured = finished[0].metrics
            why = f"is not a metric of these runs{suggest(self._metric, measured)}; they have "
            why += ", ".join(measured)
            if self._metric in measured:
                value = measured[self._metric]
                why = f"is {value!r} in run {finished[0].run}, which is not a number"
            raise WiringError(f"{argument('--optimize')} {self._metric}: it {why}: cannot optimize")
        for row in sorted(rows, key=lambda row: row.run):
            trial, value = self._asked.pop(row.run), self._value(row)
            if value is None:
                self._study.tell(trial, state=self._failed)
            else:
                self._study.tell(trial, value)

    def _value(self, row: ResultRow) -> float | None:
        """Return the metric of a run; None where it has none."""
        value = row.metrics.get(self._metric) if row.exit_code == 0 else None
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
