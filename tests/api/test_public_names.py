"""What `import stepbus` offers, and what it costs."""

import json
import subprocess
import sys
from typing import Literal, get_origin

import pytest

import stepbus
import stepbus_schemas
from stepbus import errors, messages, params, results, wiring

MODULES = (errors, messages, params, results, wiring)
PUBLIC = (
    "Config Description Event ExitCode JointCommand JointReference JointState Message Method "
    "Observer Pace Participant Progress Recording Result RunExtension RunFailure Scenario "
    "ScenarioError SensedJoints Settings Steering Step StepbusError Tolerance WiringError "
    "branch call compare describe diff errors export load main messages params recover replay "
    "report rerun results run sweep take_part testing verify wiring"
)


def test_the_public_names_are_these():
    assert " ".join(stepbus.__all__) == PUBLIC


@pytest.mark.parametrize("module", [stepbus, *MODULES])
def test_every_public_name_is_there_and_documented(module):
    for name in module.__all__:
        value = getattr(module, name)
        assert value.__doc__ or get_origin(value) is Literal
        assert name in dir(module)


@pytest.mark.parametrize("module", MODULES)
def test_a_name_in_two_places_is_the_same(module):
    both = set(module.__all__) & set(stepbus.__all__)
    assert all(getattr(module, name) is getattr(stepbus, name) for name in both)


def test_every_message_is_public():
    types = {cls.__name__ for cls in stepbus_schemas.MESSAGE_TYPES.values()} | {"Spiral"}
    assert types <= set(messages.__all__)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'stepbus' has no attribute 'rum'"):
        stepbus.rum  # noqa: B018


def loaded_by(program):
    """Return the names of the modules that a program loads."""
    code = f"{program}\nimport json, sys; print(json.dumps(list(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    return set(json.loads(done.stdout))


def test_a_participant_loads_neither_orchestrator_nor_recording():
    modules = loaded_by(
        "from stepbus import JointCommand, Participant, errors, main\n"
        "from stepbus.errors import CallError, InvalidInput\n"
        "from stepbus.messages import Poses\nfrom stepbus.params import PerJoint\n"
        "from stepbus.wiring import load_ticket"
    )
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
