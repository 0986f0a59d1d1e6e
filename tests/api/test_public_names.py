"""What `import stepbus` offers, and what it costs."""

import json
import subprocess
import sys
from typing import Literal, get_origin

import pytest
from support.exports import exported

import stepbus
import stepbus_participant
import stepbus_schemas
from stepbus import errors, messages, params, recordings, results, runs, wiring
from stepbus_orchestrator import errors as orchestrator_errors


def order(name):
    """Sort as ruff does: constants, classes, functions."""
    return (0 if name.isupper() else 1 if name[0].isupper() else 2), name


MODULES = (errors, messages, params, results, wiring)
PUBLIC = [
    "Config",
    "Description",
    "Event",
    "ExitCode",
    "JointCommand",
    "JointReference",
    "JointState",
    "Message",
    "Method",
    "Observer",
    "Pace",
    "Participant",
    "Progress",
    "Recording",
    "Result",
    "RunExtension",
    "RunFailure",
    "Scenario",
    "ScenarioError",
    "SensedJoints",
    "Settings",
    "Steering",
    "Step",
    "StepbusError",
    "Tolerance",
    "WiringError",
    "branch",
    "call",
    "compare",
    "describe",
    "diff",
    "errors",
    "export",
    "load",
    "main",
    "messages",
    "params",
    "recover",
    "replay",
    "report",
    "rerun",
    "results",
    "run",
    "sweep",
    "take_part",
    "testing",
    "verify",
    "wiring",
]


def test_the_public_names_are_these():
    assert stepbus.__all__ == PUBLIC


@pytest.mark.parametrize("package", [stepbus, errors, results, wiring])
def test_all_is_sorted(package):
    assert package.__all__ == sorted(set(package.__all__), key=order)


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


def test_a_name_that_several_packages_have_is_the_user_facing_one():
    for module in (runs, recordings):
        own = {
            n: v for n, v in vars(module).items() if getattr(v, "__module__", "") == module.__name__
        }
        public = {name: value for name, value in own.items() if name in stepbus.__all__}
        assert public
        assert all(getattr(stepbus, name) is value for name, value in public.items())


def test_what_a_participant_needs_is_public():
    internal = {"CheckpointOrder", "Clock", "Disk", "EXTRAS", "HOST", "Host", "Input", "Keys", "LONGEST_NS", "LoopbackBus", "MessageFault", "Mimic", "NO_CHECKPOINTS", "NewFile", "ONE_THREAD", "Own", "PARTICIPANTS", "Place", "ProfileOrder", "Queue", "Request", "Sample", "SlotError", "SlotWriter", "StepsOver", "TICKET_VARIABLE", "TooManyProblems", "UnknownInput", "WARNING", "ZenohBus"}  # fmt: skip
    public = {name for module in (stepbus, *MODULES) for name in module.__all__}
    offered = exported("stepbus_participant")
    functions = {name for name in offered if name.islower()}
    left_out = offered - public
    assert left_out - functions == internal
    assert {"main", "take_part"} <= set(stepbus.__all__)
    assert {"each", "when", "needed_when"} <= set(params.__all__)


def test_every_message_is_public():
    types = {cls.__name__ for cls in stepbus_schemas.MESSAGE_TYPES.values()} | {"Spiral"}
    assert types <= set(messages.__all__)


def test_every_error_is_public():
    roots = (stepbus_schemas, stepbus_participant, orchestrator_errors)
    known = {
        name for root in roots for name in exported(root.__name__) if is_error(getattr(root, name))
    }
    # Only the command line asks whether a recording is trusted; the others have one that is public
    # as their base.
    assert known - {"SlotError", "StepsOver", "TooManyProblems", "UnknownInput", "Untrusted"} == {
        name for name in errors.__all__ if is_error(getattr(errors, name))
    }


def is_error(value):
    return isinstance(value, type) and issubclass(value, stepbus.StepbusError)


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
