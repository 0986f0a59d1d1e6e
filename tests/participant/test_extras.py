"""A missing package is one sentence that says how to install it."""

import sys

import pytest

from stepbus_participant import ExtraMissing, extra_hint, import_error_hint, install_command, need


@pytest.fixture
def source(monkeypatch):
    """Return a function that sets the record pip makes of where a package is from."""

    class Distribution:
        text = None

        def read_text(self, _name):
            return self.text

    monkeypatch.setattr("importlib.metadata.distribution", lambda _name: Distribution())

    def set_source(text):
        Distribution.text = text

    return set_source


@pytest.mark.parametrize(
    ("record", "command"),
    [
        (None, "pip install 'stepbus[sim]'"),
        (
            '{"url": "file:///w/stepbus.whl", "archive_info": {}}',
            "pip install '/w/stepbus.whl[sim]'",
        ),
        ('{"url": "file:///home/me/clone", "dir_info": {}}', "pip install '/home/me/clone[sim]'"),
        (
            '{"url": "https://a.b/c.whl", "archive_info": {}}',
            "pip install 'stepbus[sim] @ https://a.b/c.whl'",
        ),
        (
            '{"url": "file:///home/me/my%20bus", "dir_info": {"editable": true}}',
            "pip install -e '/home/me/my bus[sim]'",
        ),
    ],
)
def test_the_command_fits_a_package_and_a_clone(source, record, command):
    source(record)
    assert install_command("sim") == command


def test_modules_that_are_missing_are_named_with_their_extra(source, monkeypatch):
    source(None)
    for name in ("ompl", "toppra"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ExtraMissing) as caught:
        need("the planner", "json", "ompl", "toppra")
    assert "the planner needs ompl and toppra" in str(caught.value)


def test_a_package_whose_modules_are_missing_is_named_once(source, monkeypatch):
    source(None)
    for name in ("matplotlib", "matplotlib.figure"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ExtraMissing, match=r"^a plot needs matplotlib"):
        need("a plot", "matplotlib", "matplotlib.figure")


def test_the_text_of_an_import_error_gets_its_hint(source):
    source(None)
    text = "ModuleNotFoundError: No module named 'pinocchio.casadi'"
    assert import_error_hint(text) == "; pip install 'stepbus[sim]'"
    assert import_error_hint("ModuleNotFoundError: No module named 'mine'") == ""
    assert extra_hint("matplotlib") == "; pip install 'stepbus[report]'"
