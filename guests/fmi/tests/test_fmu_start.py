"""Start values as a scenario writes them."""

from stepbus_fmi.model import named


def test_a_name_with_dots_may_be_nested_as_a_path_on_the_command_line_makes_it():
    given = {"k": 1, "motor[1]": {"lag": "2 ms", "rotor": {"J": [1, 2]}}, "a.b": 3}
    assert named(given) == {"k": 1, "motor[1].lag": "2 ms", "motor[1].rotor.J": [1, 2], "a.b": 3}
