"""Commands that installed packages add by entry points."""

from importlib.metadata import entry_points

import pytest

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.plugins import all_points

COMMAND = """
from dataclasses import KW_ONLY
from stepbus_orchestrator.cli.options import Command

class Greet(Command, work="acme_tools"):
    "Say hello."
    _: KW_ONLY
    loud: bool = False

class Lost(Command, work="acme_gone"):
    "Get lost."

def greet_command(given):
    print("HELLO" if given.loud else "hello")
    return 0
"""


@pytest.fixture
def acme(tmp_path, monkeypatch):
    """Install a package with commands: one that works, one of the core's name, two that do not."""
    (tmp_path / "acme_tools.py").write_text(COMMAND)
    info = tmp_path / "acme-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: acme\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[stepbus.commands]\ngreet = acme_tools:Greet\nvalidate = acme_tools:Greet\n"
        "lost = acme_tools:Lost\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    all_points.cache_clear()
    yield info / "entry_points.txt"
    monkeypatch.undo()
    all_points.cache_clear()


@pytest.mark.usefixtures("acme")
def test_a_command_of_another_package_works_and_is_listed(capsys):
    assert main(["greet", "--loud"]) == 0
    assert capsys.readouterr().out == "HELLO\n"
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "say hello" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["gret"])
    assert "did you mean 'greet'?" in capsys.readouterr().err


@pytest.mark.usefixtures("acme")
def test_a_command_whose_work_is_missing_is_one_line(capsys):
    assert main(["lost"]) == ExitCode.SCENARIO
    said = capsys.readouterr().err
    assert said == "stepbus: the command 'lost' cannot be loaded: No module named 'acme_gone'\n"


@pytest.mark.usefixtures("acme")
def test_no_package_replaces_a_command_of_the_core(capsys):
    assert main(["validate", "two_link", "--steps", "1"]) == 0
    assert "valid; 2000 steps" in capsys.readouterr().out


@pytest.mark.parametrize("value", ["acme_gone:Greet", "acme_tools:gone"])
def test_a_command_that_cannot_be_loaded_is_an_error_and_the_others_work(acme, capsys, value):
    acme.write_text(f"[stepbus.commands]\nbroken = {value}\n")
    assert main(["broken"]) == ExitCode.SCENARIO
    assert "the command 'broken' " in (said := capsys.readouterr().err)
    assert value in said
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    assert "run a scenario and record it" in capsys.readouterr().out


@pytest.mark.usefixtures("acme")
def test_the_entry_points_are_those_of_importlib_metadata():
    theirs = entry_points()
    groups = [group for group in theirs.groups if group.startswith("stepbus.")]
    expected = {row(point) for group in groups for point in theirs.select(group=group)}
    ours = {row(point) for point in all_points() if point.group.startswith("stepbus.")}
    assert ours == expected


def row(point):
    return point.name, point.value, point.group
