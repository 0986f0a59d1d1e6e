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
    ("library", "package"), [("libgomp.so.1", "libgomp1"), ("libGL.so.1.7.0", "libgl1")]
)
def test_a_library_that_the_system_lacks_is_named_as_its_package(library, package):
    text = f"{library}: cannot open shared object file: No such file or directory"
    assert import_error_hint(text).endswith(f": sudo apt-get install {package}")


def test_a_library_for_which_memory_is_lacking_is_not_missing():
    assert import_error_hint("libgomp.so.1: failed to map segment from shared object") == ""
