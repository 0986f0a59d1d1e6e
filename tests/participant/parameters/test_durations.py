from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepbus_participant import LONGEST_NS, format_duration, parse_duration
from stepbus_schemas import WiringError


@pytest.mark.parametrize(
    ("text", "duration_ns"),
    [
        ("5ms", 5_000_000),
        ("0.005s", 5_000_000),
        ("1/200s", 5_000_000),
        ("2min", 120_000_000_000),
        ("1h", 3_600_000_000_000),
        ("3 us", 3_000),
        ("3µs", 3_000),
        ("1ns", 1),
        ("0.1s", 100_000_000),
    ],
)
def test_a_duration_is_exact(text, duration_ns):
    assert parse_duration(text) == duration_ns


@pytest.mark.parametrize("text", ["0s", "0.00s", "0ns", "0 min", "0/3s"])
def test_zero_is_a_duration_where_it_may_be_in_every_spelling(text):
    assert parse_duration(text, may_be_zero=True) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("5", "write a number with a unit"),
        ("5 parsecs", "is not a duration"),
        ("-5ms", "is not a duration"),
        ("1e-3s", "is not a duration"),
        ("200Hz", "is not a duration"),
        ("0s", "must be longer than 0"),
        ("1/0s", "is not a duration"),
        ("999999999h", "is longer than 2^63 − 1 ns"),
        ("1/240s", "the nearest is 4166667ns"),
        ("0.1ns", "the nearest is 1ns"),
    ],
)
def test_what_is_no_duration_is_refused(text, message):
    with pytest.raises(WiringError) as caught:
        parse_duration(text)
    assert message in str(caught.value)


@given(st.integers(1, LONGEST_NS))
def test_a_duration_survives_being_written(duration_ns):
    assert parse_duration(format_duration(duration_ns)) == duration_ns
