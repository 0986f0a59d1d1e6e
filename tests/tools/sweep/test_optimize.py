"""An optimizer chooses numbers that a parameter takes, and learns from the runs that have the metric."""

import math

import msgspec
import optuna
import pytest
from support.paths import DOCS

from stepbus_schemas import WiringError
from stepbus_tools.sweep.bundle import collect
from stepbus_tools.sweep.optimize import Optimizer
from stepbus_tools.sweep.rows import ResultRow
from stepbus_tools.sweep.spec import plan
from stepbus_tools.sweep.trial import Trials

PAGE = (DOCS / "guide/running/sweeps.md").read_text()


def optimizer(axis, trials=8, batch=1):
    options = {"vary": [axis], "optimize": "rmse", "trials": trials, "batch": batch}
    return Optimizer(plan("two_link", options))


def optimized(values, batch=1):
    """Tell an optimizer the metric of each run; return how many runs it asked for.

    values: None: the run lacks the metric, or it is null there.
    """
    chosen, count = optimizer("controller.params.kp=10:400", len(values), batch), 0
    for points in chosen.batches():
        count += len(points)
        numbers = [p.number for p in points]
        metrics = [{} if values[n] is None and n % 2 else {"rmse": values[n]} for n in numbers]
        chosen.tell(
            [
                ResultRow(run=p.number, values={}, outcome="finished", exit_code=0, metrics=m)
                for p, m in zip(points, metrics, strict=True)
            ]
        )
    return count


@pytest.mark.parametrize(
    ("axis", "is_whole"),
    [
        ("controller.params.kd=0:1", False),
        ("controller.params.kp=5:80:log", False),
        ("window=1:64", True),
        ("window=1.0:64.0", True),
        ("seed=0:1000", True),
    ],
)
def test_a_range_has_the_numbers_that_its_parameter_takes(axis, is_whole):
    path = axis.partition("=")[0]
    values = [p.values[path] for points in optimizer(axis).batches() for p in points]
    assert all(isinstance(value, int) == is_whole for value in values)
    assert all(value == math.floor(value) for value in values) == is_whole
    assert len(set(values)) > 2


@pytest.mark.parametrize("batch", [1, 4])
def test_runs_without_the_metric_are_failed_ones_whatever_the_batch(batch):
    assert optimized([None] * 5 + [0.5, None, 0.4], batch) == 8


@pytest.mark.parametrize("batch", [1, 4])
def test_an_optimizer_ends_where_no_run_has_a_number(batch):
    for values in ([None] * 3, [None] * 100, ["0.5"] * 3):
        with pytest.raises(WiringError, match="rmse: it is a number in no run"):
            optimized(values, batch)
    assert optimized([True, False], batch) == 2


METRIC = """
def measure(recording):
    return {"far": float("inf"), "odd": float("nan"), "near": 0.5, "long": 2**1024}
"""


def test_a_metric_that_is_no_finite_number_is_absent_and_says_so(tmp_path):
    (tmp_path / "my.py").write_text(METRIC)
    metrics = [f"{tmp_path}/my.py:measure"]
    planned = plan("two_link", {"vary": ["seed=1,2"], "set": ["duration=50ms"], "metrics": metrics})
    bundle = collect(planned.variants, planned.spec.metrics)
    trials = Trials(bundle, tmp_path / "trials", keep="none", home=None)
    row = msgspec.json.decode(trials.run(planned.design[0], 0.0)[0], type=ResultRow)
    assert [row.metrics[name] for name in ("far", "odd", "near", "long")] == [None, None, 0.5, None]
    assert row.metric_error == f"far is inf; odd is nan; long is {2**1024}"


@pytest.mark.parametrize("direction", ["minimize", "maximize"])
@pytest.mark.filterwarnings("ignore:The value nan is not acceptable")
def test_for_optuna_alone_nan_is_a_failure_and_infinity_the_best(direction):
    infinite = math.inf if direction == "maximize" else -math.inf
    for value, best in ((math.nan, 1), (infinite, 0)):
        study = optuna.create_study(direction=direction)
        for number in (value, 0.5, 0.5):
            study.tell(study.ask(), number)
        assert study.best_trial.number == best  # of two equal ones the first


def proposed_where_runs_fail(is_failed):
    """Return how many of 40 runs are proposed above 100, where each run fails or is bad."""
    chosen, count = optimizer("controller.params.kp=10:400", trials=40), 0
    for points in chosen.batches():
        (gain,) = points[0].values.values()
        count += gain > 100
        code, value = (0, -gain) if gain <= 100 else (4, -gain) if is_failed else (0, 0.0)
        row = ResultRow(
            run=points[0].number, values={}, outcome="", exit_code=code, metrics={"rmse": value}
        )
        chosen.tell([row])
    return count


def test_a_search_does_not_avoid_where_runs_fail_but_where_they_are_bad():
    assert (proposed_where_runs_fail(True), proposed_where_runs_fail(False)) == (34, 23)
    assert "34 of 40" in PAGE
    assert "23" in PAGE
