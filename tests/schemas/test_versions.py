"""Ranges of protocol numbers, and messages with the names of earlier ones."""

import pytest

from stepbus_schemas import Hello, Protocols, offered


@pytest.mark.parametrize(
    ("one", "other", "number"),
    [
        ((2, 2), (1, 2), 2),
        ((2, 3), (1, 2), 2),
        ((1, 1), (1, 2), 1),
        ((1, 9), (1, 2), 2),
        ((3, 4), (1, 2), None),
        ((0, 0), (1, 2), None),
        ((2, 1), (1, 2), None),
    ],
)
def test_two_ranges_have_their_highest_common_number(one, other, number):
    assert Protocols(*one).common(Protocols(*other)) == number
    assert Protocols(*other).common(Protocols(*one)) == number


@pytest.mark.parametrize(
    ("fields", "numbers"), [({}, (2, 2)), ({"lowest_protocol": 1}, (1, 2)), ({"lowest_protocol": 2}, (2, 2))]
)  # fmt: skip
def test_a_hello_that_names_one_number_offers_that_alone(fields, numbers):
    hello = Hello(protocol=2, name="plant", token="00", pid=7, **fields)
    assert offered(hello) == Protocols(*numbers)
