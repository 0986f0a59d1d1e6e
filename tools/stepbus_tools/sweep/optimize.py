"""An optimizer chooses the points of a sweep: Optuna, asked and told in batches.

A batch has the same size whatever the number of cores, and is told in order: the same seed gives
the same sequence everywhere.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from stepbus_participant import need, suggest
from stepbus_schemas import WiringError
from stepbus_tools.sweep.axes import Axis, Point
from stepbus_tools.sweep.rows import ResultRow
from stepbus_tools.sweep.spec import Plan

_RANDOM = 10
"""Points that Optuna draws at random; without a number of them, it has nothing to learn from."""


class Optimizer:
    """Asks Optuna for points, and tells it the metrics of their runs."""

    def __init__(self, plan: Plan) -> None:
        (optuna,) = need("--optimize", "optuna")
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
        self._first: ResultRow | None = None
        self._finished, self._has_number = 0, False
        self.paths = [path for axis in plan.axes for path in axis.paths]

    def __len__(self) -> int:
        """Return the number of runs."""
        return self._trials

    def batches(self) -> Iterator[list[Point]]:
        """Yield the points of each batch; call `tell` with their rows before the next."""
        for first in range(0, self._trials, self._batch):
            last = min(first + self._batch, self._trials)
            points = []
            for number in range(first, last):
                trial = self._asked[number] = self._study.ask()
                values = {axis.paths[0]: _suggest(trial, axis) for axis in self._axes}
                points.append(Point(number, values))
            yield points

    def tell(self, rows: Sequence[ResultRow]) -> None:
        """Report the rows of a batch to Optuna; a run without the metric counts as failed.

        Raises WiringError where no run has a number to optimise: after the first ten, or all.
        """
        for row in sorted(rows, key=lambda row: row.run):
            trial, value = self._asked.pop(row.run), self._value(row)
            if value is None:
                self._study.tell(trial, state=self._failed)
            else:
                self._study.tell(trial, value)
                self._has_number = True
            if row.exit_code == 0:
                self._finished += 1
                self._first = self._first or row
        is_over = rows[-1].run == self._trials - 1
        if self._first and not self._has_number and (is_over or self._finished >= _RANDOM):
            known = self._first.metrics
            more = "" if self._metric in known else suggest(self._metric, known)
            raise WiringError(
                f"--optimize {self._metric}: it is a number in no run{more}; they "
                f"have {', '.join(known)}"
            )

    def _value(self, row: ResultRow) -> float | None:
        """Return the metric of a run; None where it has none."""
        value = row.metrics.get(self._metric) if row.exit_code == 0 else None
        return float(value) if isinstance(value, int | float) else None


def _suggest(trial: Any, axis: Axis) -> Any:
    path, span = axis.paths[0], axis.span
    if span is None:
        index = trial.suggest_categorical(path, range(len(axis.values)))
        return axis.values[index][0]
    if span.is_whole:
        return trial.suggest_int(path, int(span.low), int(span.high), log=span.is_log)
    return trial.suggest_float(path, span.low, span.high, log=span.is_log)
