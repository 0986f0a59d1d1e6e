"""Units of messages and of FMUs: what they are converted by, and which are refused."""

import pytest
from stepbus_fmi.units import Units

from stepbus_schemas import WiringError

NONE = Units([], "")


PLAIN = {
    "rad/s": "1/s",
    "N·m": "newton*meter",
    "m/s²": "m/s**2",
    "kg·m²": "kg*m**2",
    "N·m·s/rad": "N*m*s",
    "m³": "meter**3",
    "V": "volt",
    "Pa": "pascal",
}


@pytest.mark.parametrize(("unit", "by_pint"), PLAIN.items())
def test_a_unit_of_messages_is_the_one_of_pint(unit, by_pint):
    assert NONE.conversion(unit, by_pint) == (1.0, 0.0)


def test_others_are_those_of_pint():
    assert NONE.conversion("kN·m", "N·m") == (1000.0, 0.0)
    assert NONE.conversion("degC", "K") == (1.0, 273.15)


def test_of_a_field_with_a_unit_for_each_mode_the_one_that_fits_counts():
    of_a_command = "N·m, rad/s, rad, rad, -"
    assert NONE.conversion(of_a_command, "kN·m") == (0.001, 0.0)
    with pytest.raises(WiringError, match=r"unit 'N·m, rad/s, rad, rad, -' is no 'kg'"):
        NONE.conversion(of_a_command, "kg")
