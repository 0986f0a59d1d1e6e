"""Small charts: the labels of their ticks, their legend, and what is said of them."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepbus_tools.report.charts import Chart, ChartLine
from stepbus_tools.viewing.page.curves_html import _said
from stepbus_tools.viewing.page.small import labels_of, nice_ticks, small_chart

TIMES = np.array([0.0, 1.0])


def chart(*rows, unit="rad", limits=()):
    lines = [ChartLine(f"{n}", (TIMES, np.array(row)), number=n) for n, row in enumerate(rows)]
    return Chart("position", unit, lines, limits)


@given(st.floats(-1e9, 1e9), st.floats(-10, 3))
def test_labels_of_ticks_are_short_and_never_the_same(low, exponent):
    labels, _ = labels_of(nice_ticks(low, low + (abs(low) or 1.0) * 10**exponent, 4))
    assert len(set(labels)) == len(labels) > 0
    assert max(map(len, labels)) <= 9


def test_what_ticks_have_in_common_stands_above_them():
    assert labels_of([-0.67002, -0.67001]) == (["-0.67002", "-0.67001"], "")
    assert labels_of([-1.5707963, -1.5707962]) == (["+0", "+1e-7"], "-1.5707963 +")
    picture = small_chart(chart([-1.5707963, -1.5707960]), (), 1.0)
    assert "-1.5707963 +" in picture


def test_the_axis_leaves_room_for_its_longest_label():
    picture = small_chart(chart([-0.67002, -0.66999]), (), 1.0)
    labels = re.findall(r'x="([\d.]+)" y="[\d.]+" text-anchor="end">(-0\.\d+)<', picture)
    assert len(labels) > 1
    assert all(float(x) >= 6 * len(text) for x, text in labels)


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


def test_a_range_too_small_for_numbers_has_one_tick():
    assert nice_ticks(0.0, 5e-324, 4) == [0.0]
