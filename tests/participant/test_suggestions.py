"""The nearest name to one that nobody knows."""

from __future__ import annotations

from stepbus_participant import suggest


def test_the_nearest_name_is_suggested_and_else_all_are_listed():
    assert suggest("plnt", ["plant", "mission"]) == "; did you mean 'plant'?"
    assert suggest("x", ["plant", "mission"]) == "; known: plant, mission"
    assert suggest("x", []) == ""


def test_of_many_names_some_are_listed():
    text = suggest("x", [f"port{n}" for n in range(100_000)])
    assert text.startswith("; known: port0, port1, ")
    assert text.endswith(", port39 … (100000 in all)")


def test_of_two_letters_one_may_be_wrong_or_both_swapped():
    assert suggest("kq", ["law", "kp", "kd"]) == "; did you mean 'kp' or 'kd'?"
    assert suggest("pk", ["law", "kp"]) == "; did you mean 'kp'?"
    assert suggest("xy", ["law", "kp"]) == "; known: law, kp"


def test_capital_letters_make_no_difference():
    assert suggest("KP", ["law", "kp"]) == "; did you mean 'kp'?"
    assert suggest("Duration", ["duration", "step"]) == "; did you mean 'duration'?"
