"""A package that participants of ours need, and that is not installed, is named before the start."""

import subprocess
import sys

import pytest

import stepbus
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.program import NEEDS, check_installed, participant_classes

WITHOUT = """
import sys
for name in sys.argv[2:]:
    sys.modules[name] = None
"""
START = (
    WITHOUT
    + """
from pathlib import Path
from stepbus_participant import import_participant
import_participant(sys.argv[1], Path())
"""
)
PROGRAMS = [name for name in participant_classes() if not name.startswith("stepbus_store")]


def start(*arguments):
    command = [sys.executable, "-c", START, *arguments]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=100)


def test_from_python_it_is_an_error_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    sentence = r"participants\.plant: stepbus_plant needs pybullet or mujoco"
    with pytest.raises(stepbus.errors.ExtraMissing, match=sentence):
        stepbus.run("two_link", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_another_interpreter_or_somebody_else_starts_may_have_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    program = f"plant.exec=[{sys.executable}, -m, stepbus_participant, 'stepbus_plant:Plant']"
    for setting in ("plant.start=external", program):
        assert check_installed(load("two_link", [setting])) is None
    with pytest.raises(stepbus.errors.ExtraMissing):
        check_installed(load("two_link"))


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS)
def test_the_table_has_what_a_program_imports_at_its_start(program):
    needs = {
        name
        for key, names in NEEDS.items()
        if f"{program.partition(':')[0]}.".startswith(f"{key}.")
        for name in names
        if " or " not in name  # the plant loads the engine of its world
    }
    packages = ("pybullet", "pinocchio")
    fails = {name for name in packages if start(program, name).returncode}
    assert fails == needs
