"""Numbers with the prefixes that engineers use."""

import pytest

from stepbus_tools.report.units import engineering, told_apart


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1e-4, "rad", "0.1 mrad"),
        (0.000338, "rad", "0.338 mrad"),
        (0.5, "rad", "0.5 rad"),
        (-0.05, "m", "-50 mm"),
        (5e-5, "m", "50 µm"),
        (1e-9, "m", "1 nm"),
        (1e-12, "m", "0.001 nm"),
        (4200.0, "N", "4.2 kN"),
        (4200.0, "m", "4.2e+03 m"),
        (0.02, "N·m", "20 mN·m"),
        (0.02, "m/s²", "20 mm/s²"),
        (0.001, "s", "0.001 s"),
        (0.001, "", "0.001"),
        (0.001, "min", "0.001 min"),
        (0.0, "rad", "0 rad"),
        (float("nan"), "rad", "nan rad"),
    ],
)
def test_a_number_gets_the_prefix_of_its_size(value, unit, text):
    assert engineering(value, unit) == text


@pytest.mark.parametrize(
    ("first", "second", "unit", "texts"),
    [
        (22.749310079715613, 22.35167685325915, "N·m", ("22.75 N·m", "22.35 N·m")),
        (0.001, 0.0010000123, "rad", ("1 mrad", "1.000012 mrad")),
        (1.0, -1.0, "", ("1", "-1")),
        (1.0, float("nan"), "m", ("1.0 m", "nan m")),
    ],
)
def test_two_numbers_have_the_digits_that_tell_them_apart(first, second, unit, texts):
    assert told_apart(first, second, unit) == texts
