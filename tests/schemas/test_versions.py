"""Which protocol numbers a message of the handshake offers."""

import pytest

from stepbus_schemas import Hello, Protocols, offered


@pytest.mark.parametrize(
    ("fields", "numbers"), [({}, (2, 2)), ({"lowest_protocol": 1}, (1, 2)), ({"lowest_protocol": 2}, (2, 2))]
)  # fmt: skip
def test_a_hello_that_names_one_number_offers_that_alone(fields, numbers):
    hello = Hello(protocol=2, name="plant", token="00", pid=7, **fields)
    assert offered(hello) == Protocols(*numbers)
