"""Numbers with the prefixes that engineers use."""

import pytest

from stepbus_tools.theme import engineering


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
