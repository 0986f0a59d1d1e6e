"""Two messages are equal to the byte, or within a tolerance, or the first field that differs is named."""

import math

import msgspec
import pytest

from stepbus_orchestrator.analysis.divergence import PortComparison, port_lines
from stepbus_orchestrator.analysis.tolerance import FieldTolerance, Tolerance
from stepbus_schemas import JointCommand, JointState, Poses, encode

TOPIC = "controller/command"


def command(*values, mode="torque", **more):
    return encode(JointCommand(mode=mode, values=list(values), **more))


def compared(first, second, rules=None, type_name="JointCommand/1"):
    """Return the result of comparing one message at step 7."""
    comparison = PortComparison(TOPIC, type_name, Tolerance(rules or {}))
    comparison.take(7, first, second)
    return comparison.result()


def test_the_first_differing_field_is_named_with_its_index_and_both_values():
    found = compared(command(1.0, 2.0, 3.0), command(1.0, 2.5, 4.0)).divergence
    assert (found.step, found.field, found.first, found.second) == (7, "values[1]", 2.0, 2.5)
    assert "values[1]: first 2.0, second 2.5" in found.text()


def test_the_place_of_a_difference_has_the_name_of_its_joint():
    names = ["shoulder", "elbow"]
    comparison = PortComparison(TOPIC, "JointCommand/1", Tolerance(), names=names)
    comparison.take(7, command(1.0, 2.0), command(1.0, 2.5))
    found = comparison.result()
    assert "values[elbow]: first" in found.divergence.text()
    assert "(values[elbow] at step 7)" in list(port_lines(found, "first", "second", None))[-1]


def test_the_largest_difference_of_a_field_is_kept_with_its_place():
    comparison = PortComparison(TOPIC, "JointCommand/1", Tolerance())
    for step, value in enumerate((2.5, 2.0, 4.0, 3.0)):
        comparison.take(step, command(1.0, 2.0), command(1.0, value))
    (count,) = comparison.result().fields
    assert (count.field, count.different, count.largest) == ("values", 3, 2.0)
    assert (count.at_step, count.at) == (2, "values[1]")


@pytest.mark.parametrize(
    ("tolerance", "first", "second", "equal"),
    [
        (FieldTolerance(abs=1e-3), 1.0, 1.0009, True),
        (FieldTolerance(abs=1e-3), 1.0, 1.002, False),
        (FieldTolerance(rel=1e-3), 100.0, 100.09, True),
        (FieldTolerance(rel=1e-3), 100.0, 100.2, False),
        (FieldTolerance(abs=0.1, rel=1e-3), 100.0, 100.15, True),
        (FieldTolerance(abs=1.0), math.nan, math.nan, True),
        (FieldTolerance(abs=1.0), math.nan, 0.0, False),
        (FieldTolerance(abs=1.0), math.inf, math.inf, True),
        (FieldTolerance(rel=1.0), math.inf, 0.0, False),
        (FieldTolerance(), 0.0, -0.0, True),
        (FieldTolerance(ignore=True), math.nan, 7.0, True),
    ],
)
def test_a_tolerance_allows_what_it_says(tolerance, first, second, equal):
    result = compared(command(first), command(second), {(TOPIC, "values"): tolerance})
    assert (result.divergence is None) is equal


def test_zero_and_minus_zero_are_not_the_same_bits():
    found = compared(command(0.0), command(-0.0)).divergence
    assert (found.field, str(found.second)) == ("values[0]", "-0.0")


def test_nan_equals_nan_whatever_its_bits():
    nan = command(math.nan)
    other = nan.replace(msgspec.msgpack.encode(math.nan), bytes.fromhex("cbfff8000000000001"))
    assert nan != other
    result = compared(nan, other, {(TOPIC, "values"): FieldTolerance()})
    assert (result.within, result.divergence) == (1, None)


def test_the_same_values_in_other_bytes_are_named_as_such():
    reverse = msgspec.msgpack.encode({"values": [1.0], "mode": "torque"})
    found = compared(command(1.0), reverse).divergence
    assert (found.type, found.field) == ("encoding", "")
    assert "same values, different bytes" in found.text()


def test_a_tolerance_is_for_numbers_only():
    result = compared(
        command(1.0), command(1.0, mode="velocity"), {("*", "*"): FieldTolerance(abs=9.0)}
    )
    assert result.divergence.field == "mode"


def deep(number):
    return msgspec.msgpack.encode({"deep": {"a": [number]}})


@pytest.mark.parametrize(
    ("first", "second", "type_name", "difference"),
    [
        (command(1.0), command(1.0, 2.0), "JointCommand/1", ("values", [1.0], [1.0, 2.0])),
        (
            encode(JointState(position=[1.0])), encode(JointState()), "JointState/1",
            ("position", [1.0], None),
        ),
        (deep(1), deep(2), "Later/3", ("deep.a[0]", 1, 2)),
    ],
    ids=["length", "lacking", "unknown type"],
)  # fmt: skip
def test_vectors_lacking_fields_and_types_of_another_version_are_compared(
    first, second, type_name, difference
):
    found = compared(first, second, {("*", "*"): FieldTolerance(abs=0.5)}, type_name).divergence
    assert (found.field, found.first, found.second) == difference


def test_a_tolerance_holds_for_each_number_of_a_point():
    def poses(*position):
        return encode(Poses(position=[position], orientation=[(0.0, 0.0, 0.0, 1.0)]))

    first, near, far = poses(1.0, 2.0, 3.0), poses(1.0, 2.0000001, 3.0), poses(1.0, 2.1, 3.0)
    rules = {("*", "*"): FieldTolerance(abs=1e-6)}
    assert compared(first, near, rules, "Poses/1").within == 1
    found = compared(first, far, rules, "Poses/1").divergence
    assert (found.field, found.first, found.second) == ("position[0][1]", 2.0, 2.1)
