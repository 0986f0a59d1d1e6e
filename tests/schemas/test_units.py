"""Units of fields, as they are written."""

from __future__ import annotations

import pytest

from stepbus_participant import Problems
from stepbus_participant.parameters import read_types
from stepbus_schemas import MESSAGE_TYPES, json_schema, unit_problem

UNITS = [
    "N", "kN", "N·m", "N·m/rad", "rad/s²", "m/s^2", "m, m, rad", "1/s²", "kg·m²", "µs", "%", "-",
    "°C", "deg/s", "pixel", "m/(s rad)", "s⁻¹", "{spins}/min", "rpm", "Ω", "m/s2", "",
]  # fmt: skip


@pytest.mark.parametrize("unit", UNITS)
def test_what_engineers_write_is_a_unit(unit):
    assert unit_problem(unit) == ""


@pytest.mark.parametrize("name", MESSAGE_TYPES)
def test_the_types_that_ship_have_units_that_are_known(name):
    rows = json_schema(name)["properties"].values()
    assert [
        unit_problem(row["unit"]) for row in rows if "unit" in row if unit_problem(row["unit"])
    ] == []


@pytest.mark.parametrize(
    ("unit", "part", "meant"),
    [
        ("newtons", "newtons", "N"),
        ("Nm", "Nm", "N·m"),
        ("meters/s", "meters", "m"),
        ("rads", "rads", "rad"),
        ("degrees", "degrees", "deg"),
        ("km/hour", "hour", "h"),
    ],
)
def test_a_word_for_a_unit_is_told_its_symbol(unit, part, meant):
    assert unit_problem(unit).startswith(
        f"{part!r} is not a known unit; did you mean {meant!r}?; write SI symbols"
    )


def test_an_unknown_unit_of_a_declared_type_is_refused_with_its_place():
    field = {"type": "float", "unit": "newtons"}
    problems = Problems()
    assert read_types({"Thruster/1": {"force": field, "mode": ["off", "on"]}}, problems) == {}
    (wrong,) = problems.plain
    assert wrong[0] == ("Thruster/1", "force", "unit")
    assert "did you mean 'N'?" in wrong[1]
