"""An optimizer chooses numbers that a parameter takes, and learns from the runs that have the metric."""

import math

import msgspec
import pytest

from stepbus_schemas import WiringError
from stepbus_tools.sweep.bundle import collect
from stepbus_tools.sweep.optimize import Optimizer
from stepbus_tools.sweep.rows import ResultRow
from stepbus_tools.sweep.spec import plan
from stepbus_tools.sweep.trial import Trials


def optimizer(axis, trials=8, batch=1):
    options = {"vary": [axis], "optimize": "rmse", "trials": trials, "batch": batch}
    return Optimizer(plan("two_link", options))


def optimized(values, batch=1):
    """Tell an optimizer the metric of each run; return how many runs it asked for."""
    chosen, count = optimizer("controller.params.kp=10:400", len(values), batch), 0
    for points in chosen.batches():
        count += len(points)
        metrics = [{} if values[p.number] is None else {"rmse": values[p.number]} for p in points]
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
    for count in (3, 100):
        with pytest.raises(WiringError, match="rmse: it is a number in no run"):
            optimized([None] * count, batch)


METRIC = """
def measure(recording):
    return {"far": float("inf"), "odd": float("nan"), "near": 0.5}
"""


def test_a_metric_that_is_no_finite_number_is_absent_and_says_so(tmp_path):
    (tmp_path / "my.py").write_text(METRIC)
    metrics = [f"{tmp_path}/my.py:measure"]
    planned = plan("two_link", {"vary": ["seed=1,2"], "set": ["duration=50ms"], "metrics": metrics})
    bundle = collect(planned.variants, planned.spec.metrics)
    trials = Trials(bundle, tmp_path / "trials", keep="none", home=None)
    row = msgspec.json.decode(trials.run(planned.design[0], 0.0)[0], type=ResultRow)
    assert [row.metrics[name] for name in ("far", "odd", "near")] == [None, None, 0.5]
    assert row.metric_error == "far is inf; odd is nan"
