"""The best and the worst run of a sweep."""

from types import SimpleNamespace

import pytest

from stepbus_tools.sweep.spec import Spec
from stepbus_tools.sweep.sweep_page import extremes


def numbers(*values, maximize=False):
    """Return the runs that are extreme among those with these metrics; None: a run that fails."""
    rows = [
        SimpleNamespace(run=n, exit_code=3, metrics={"success": False})
        if value is None
        else SimpleNamespace(run=n, exit_code=0, metrics={"success": True, "rmse": value})
        for n, value in enumerate(values)
    ]
    journal = SimpleNamespace(values=lambda: rows)
    found = extremes(journal, Spec(scenario="two_link", optimize="rmse", maximize=maximize))
    return {name: row.run for name, row in found.items()}


@pytest.mark.parametrize(
    ("values", "maximize", "found"),
    [
        ((3.0, 1.0, 2.0), False, {"best": 1, "worst": 0}),
        ((3.0, 1.0, 2.0), True, {"best": 0, "worst": 1}),
        ((None, 3.0, 1.0), False, {"best": 2, "worst": 1}),
        ((None, 3.0), False, {"best": 1}),
        ((2.0, 2.0), False, {"best": 0}),
        ((1.0, 2.0, 2.0, 1.0), True, {"best": 1, "worst": 0}),
        ((None,), False, {}),
    ],
)
def test_the_extremes_are_those_of_the_metric_that_is_searched(values, maximize, found):
    assert numbers(*values, maximize=maximize) == found


def test_a_run_that_lacks_the_metric_does_not_decide_which_one_is_compared():
    metrics = [{"energy": 1.0}, {"energy": 9.0, "rmse": 0.5}, {"energy": 5.0, "rmse": 0.7}]
    rows = [SimpleNamespace(run=n, exit_code=0, metrics=own) for n, own in enumerate(metrics)]
    journal = SimpleNamespace(values=lambda: rows)
    found = extremes(journal, Spec(scenario="two_link", optimize="rmse"))
    assert {name: row.run for name, row in found.items()} == {"best": 1, "worst": 2}
