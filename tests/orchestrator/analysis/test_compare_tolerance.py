"""Tolerances come from a YAML file or the command line; a mistake in them is named."""

import pytest

from stepbus_orchestrator.analysis.tolerance import (
    FieldTolerance,
    Tolerance,
    parse_tolerance,
    read_tolerance,
)
from stepbus_schemas import WiringError

FIELDS = {"controller/command": ("mode", "values"), "plant/joint_state": ("position",)}


def read(folder, text):
    path = folder / "tolerance.yaml"
    path.write_text(text)
    return read_tolerance(path)


def test_a_file_names_ports_and_fields(tmp_path):
    text = "controller/command: {values: {abs: 1e-9, rel: 1e-6}, mode: ignore}\nplant/joint_state: ignore\n"
    assert read(tmp_path, text).rules == {
        ("controller/command", "values"): FieldTolerance(abs=1e-9, rel=1e-6),
        ("controller/command", "mode"): FieldTolerance(ignore=True),
        ("plant/joint_state", "*"): FieldTolerance(ignore=True),
    }


def test_every_mistake_of_a_file_is_named_with_its_line(tmp_path):
    text = "a/b: {c: {abs: -1}}\nd/e:\n  f: {ads: 1}\ng/h: 3\ni/j: {k: {rel: .inf}}\n"
    with pytest.raises(WiringError) as caught:
        read(tmp_path, text)
    assert [line.split(": ")[0] for line in str(caught.value).splitlines()] == [
        "tolerance.yaml:1",
        "tolerance.yaml:3",
        "tolerance.yaml:4",
        "tolerance.yaml:5",
    ]


def test_an_empty_file_is_refused(tmp_path):
    with pytest.raises(WiringError, match="a tolerance file must map topics"):
        read(tmp_path, "")


def test_the_command_line_names_ports_of_the_participant_or_topics():
    tolerance = parse_tolerance(
        ["1e-9", "command=1e-6", "plant/joint_state.position=2"], ["1e-3"], ["status"], "controller"
    )
    assert tolerance.rules == {
        ("*", "*"): FieldTolerance(abs=1e-9, rel=1e-3),
        ("controller/command", "*"): FieldTolerance(abs=1e-6),
        ("plant/joint_state", "position"): FieldTolerance(abs=2.0),
        ("controller/status", "*"): FieldTolerance(ignore=True),
    }


@pytest.mark.parametrize("text", ["x", "command=", "command=-1", "command=nan", "command=inf"])
def test_a_tolerance_that_is_no_number_is_refused(text):
    with pytest.raises(WiringError, match=r"--abs .*not a finite number ≥ 0"):
        parse_tolerance([text], [], [])


def test_the_more_exact_entry_holds():
    rules = {
        ("*", "*"): FieldTolerance(abs=1.0),
        ("a/b", "*"): FieldTolerance(abs=2.0),
        ("a/b", "c"): FieldTolerance(abs=3.0),
    }
    found = [Tolerance(rules).of(*key) for key in (("a/b", "c"), ("a/b", "d"), ("e/f", "c"))]
    assert [tolerance.abs for tolerance in found] == [3.0, 2.0, 1.0]


def test_the_command_line_goes_before_the_file(tmp_path):
    file = read(tmp_path, "a/b: {c: {abs: 1}, d: {abs: 1}}")
    both = file | parse_tolerance(["a/b.c=2"], [], [])
    assert (both.rules["a/b", "c"].abs, both.rules["a/b", "d"].abs) == (2.0, 1.0)


@pytest.mark.parametrize(
    ("rule", "sentence"),
    [
        (("controller/comand", "*"), "no port 'controller/comand' in the recording; did you mean"),
        (("controller/command", "value"), "no field 'value' in controller/command; did you mean"),
        (("*", "speed"), "no field 'speed' in any channel"),
    ],
)
def test_a_name_that_nobody_has_is_refused(rule, sentence):
    with pytest.raises(WiringError, match=sentence):
        Tolerance({rule: FieldTolerance()}).check(FIELDS)
