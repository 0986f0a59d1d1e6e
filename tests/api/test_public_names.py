"""What `import stepbus` offers, and what it costs."""

import json
import subprocess
import sys

import pytest

import stepbus
import stepbus_orchestrator
import stepbus_participant
import stepbus_schemas
from stepbus import recordings, runs


def order(name):
    """Sort as ruff does: constants, classes, functions."""
    return (0 if name.isupper() else 1 if name[0].isupper() else 2), name


@pytest.mark.parametrize("package", [stepbus, stepbus_orchestrator])
def test_all_is_sorted(package):
    assert package.__all__ == sorted(set(package.__all__), key=order)


@pytest.mark.parametrize("name", stepbus.__all__)
def test_every_public_name_is_there_and_documented(name):
    value = getattr(stepbus, name)
    assert getattr(value, "__doc__", "")
    assert name in dir(stepbus)


def test_a_name_that_several_packages_have_is_the_user_facing_one():
    assert stepbus.Scenario is runs.Scenario
    assert stepbus.CheckedScenario is stepbus_orchestrator.Scenario
    for module in (runs, recordings):
        own = {
            n: v for n, v in vars(module).items() if getattr(v, "__module__", "") == module.__name__
        }
        public = {name: value for name, value in own.items() if name in stepbus.__all__}
        assert public
        assert all(getattr(stepbus, name) is value for name, value in public.items())


def test_what_a_participant_needs_is_public():
    internal = {"CheckpointOrder", "Clock", "HOST", "Host", "Input", "LONGEST_NS", "LoopbackBus", "MessageFault", "Mimic", "NO_CHECKPOINTS", "ONE_THREAD", "Own", "PARTICIPANTS", "ProfileOrder", "Queue", "Request", "StepsOver", "TICKET_VARIABLE", "ZenohBus"}  # fmt: skip
    functions = {name for name in stepbus_participant.__all__ if name.islower()}
    left_out = set(stepbus_participant.__all__) - set(stepbus.__all__)
    assert left_out - functions == internal
    assert {"each", "load_ticket", "main", "take_part", "when"} <= set(stepbus.__all__)


def test_every_message_is_public():
    messages = {cls.__name__ for cls in stepbus_schemas.MESSAGE_TYPES.values()} | {"Spiral"}
    assert messages <= set(stepbus.__all__)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'stepbus' has no attribute 'rum'"):
        stepbus.rum  # noqa: B018


def loaded_by(program):
    """Return the names of the modules that a program loads."""
    code = f"{program}\nimport json, sys; print(json.dumps(list(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    return set(json.loads(done.stdout))


def test_a_participant_loads_neither_orchestrator_nor_recording():
    modules = loaded_by("from stepbus import JointCommand, Participant, main")
    heavy = {"mcap", "rich", "ruamel.yaml", "stepbus_orchestrator", "matplotlib", "pybullet"}
    assert modules & heavy == set()


def test_running_a_scenario_loads_no_service_and_no_plots():
    modules = loaded_by("import stepbus; stepbus.run")
    assert modules & {"rich", "matplotlib", "pybullet", "pinocchio", "pytest"} == set()


def test_importing_sets_no_environment_variable():
    code = """
import os, sys
before = dict(os.environ)
import stepbus, stepbus.runs, stepbus.recordings, stepbus.testing
sys.exit(os.environ != before)
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
