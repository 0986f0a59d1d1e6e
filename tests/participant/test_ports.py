"""Ports that are found by their types."""

from pathlib import Path

import pytest

from stepbus_participant import Config, Ports
from stepbus_schemas import InputConfig


def ports(*names):
    inputs = {name: InputConfig(source="plant", port=name, type="Poses/1") for name in names}
    return Ports(
        Config(
            name="me",
            step_ns=1,
            every=1,
            seed=0,
            folder=Path(),
            inputs=inputs,
            outputs={},
            params={},
        )
    )


def test_the_only_input_of_a_type_is_both():
    assert ports("truth").input_beside("Poses/1", "planogram") == ("truth", "truth")


@pytest.mark.parametrize("names", [("truth", "planogram"), ("planogram", "truth")])
def test_of_two_inputs_one_has_the_name(names):
    assert ports(*names).input_beside("Poses/1", "planogram") == ("truth", "planogram")


@pytest.mark.parametrize("names", [(), ("one", "other"), ("one", "other", "planogram")])
def test_any_other_number_or_name_is_a_problem(names):
    found = ports(*names)
    found.input_beside("Poses/1", "planogram")
    assert len(found.problems) == 1
