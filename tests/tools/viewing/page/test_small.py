"""Small charts: what is said of them."""

import numpy as np
import pytest

from stepbus_tools.report.charts import Chart, ChartLine
from stepbus_tools.viewing.page.content import StepTimes
from stepbus_tools.viewing.page.curve_data import _said

TIMES = np.array([0.0, 1.0])


def chart(*rows, unit="rad", limits=()):
    lines = [ChartLine(f"{n}", (TIMES, np.array(row)), number=n) for n, row in enumerate(rows)]
    return Chart("position", unit, lines, limits)


@pytest.mark.parametrize(
    ("row", "limits", "said"),
    [
        ([0.0, 0.004], (-1.0, 1.0), "< 1 % of limit used"),
        ([0.0, 0.0], (-1.0, 1.0), "0 % of limit used"),
        ([0.0, 0.5], (-1.0, 1.0), "50 % of limit used"),
        ([40.0, -60.2], (), "at most |60.2| N"),
        ([-40.0, 60.2], (), "at most 60.2 N"),
    ],
)
def test_what_a_chart_comes_to_is_true(row, limits, said):
    assert _said(chart(row, unit="N", limits=limits)) == said


def test_step_times_are_those_of_all_steps_taken_piece_by_piece():
    times = np.random.default_rng(3).lognormal(3.0, 1.0, size=(5000, 2))
    taken = StepTimes()
    for piece in np.array_split(times, 7):
        taken.take(piece)
    mean, p99, longest, wait = taken.figures
    compute = times[:, 1]
    assert (mean, longest, wait) == pytest.approx(
        (compute.mean(), compute.max(), times[:, 0].mean())
    )
    assert p99 == pytest.approx(np.percentile(compute, 99), rel=0.01)
