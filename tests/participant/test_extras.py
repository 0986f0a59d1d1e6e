"""A missing package is one sentence that says how to install it."""

import sys

import pytest

from stepbus_participant import ExtraMissing, extra_hint, import_error_hint, need


def test_modules_that_are_missing_are_named_with_their_extra(monkeypatch):
    for name in ("ompl", "toppra"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ExtraMissing) as caught:
        need("the planner", "json", "ompl", "toppra")
    assert "the planner needs ompl and toppra" in str(caught.value)


def test_a_package_whose_modules_are_missing_is_named_once(monkeypatch):
    for name in ("matplotlib", "matplotlib.figure"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ExtraMissing, match=r"^a plot needs matplotlib"):
        need("a plot", "matplotlib", "matplotlib.figure")


def test_the_text_of_an_import_error_gets_its_hint():
    text = "ModuleNotFoundError: No module named 'pinocchio.casadi'"
    assert import_error_hint(text) == "; pip install 'stepbus[sim]'"
    assert import_error_hint("ModuleNotFoundError: No module named 'mine'") == ""
    assert extra_hint("matplotlib") == "; pip install 'stepbus[report]'"


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("libgomp.so.1: cannot open shared object file: No such file", "apt-get install libgomp1"),
        ("libGL.so.1.7.0: cannot open shared object file: No such file", "apt-get install libgl1"),
        ("libgomp.so.1: failed to map segment from shared object", ""),
    ],
)
def test_a_library_that_the_system_lacks_is_named_as_its_package(text, hint):
    found = import_error_hint(text)
    assert found.endswith(hint)
    assert bool(found) == bool(hint)
