"""What is loaded before anything happens: each module more is a part of every start."""

import json
import subprocess
import sys

import pytest

from stepbus_orchestrator.errors import ExitCode

CLI = "stepbus_orchestrator.cli"
SLOW = {"argparse", "logging", "msgspec", "numpy", "rich", "ruamel", "stepbus_schemas"}
LIBRARIES = {
    *("PIL", "coal", "cryptography", "email", "greenlet", "importlib.metadata", "matplotlib"),
    *("numpy", "pandas", "pinocchio", "pybullet", "rich", "scipy", "trustme"),
}


def loaded_by(code):
    """Return the modules that a program loads, beside those that Python has at its start."""
    program = f"""
import sys
before = set(sys.modules)
try:
    {code}
finally:
    loaded = set(sys.modules) - before
    sys.__stderr__.write("loaded:" + " ".join(sorted(loaded)))
"""
    command = [sys.executable, "-P", "-c", program]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    return done, set(done.stderr.rpartition("loaded:")[2].split())


@pytest.mark.parametrize("words", [["--help"], ["run", "--help"], ["sweep", "--help"]])
def test_help_loads_nothing_that_commands_need(words):
    run = f"sys.argv = ['stepbus', *{words}]; from {CLI} import main; sys.exit(main())"
    done, modules = loaded_by(run)
    assert (done.returncode, done.stdout[:15]) == (ExitCode.FINISHED, "usage: stepbus ")
    assert not modules & SLOW


def test_the_orchestrator_of_a_run_loads_no_library_of_its_participants(tmp_path):
    words = ["run", "two_link", "--set", "duration=10ms", "--json", "--no-report"]
    words += ["--out", str(tmp_path / "run")]
    done, modules = loaded_by(f"from {CLI} import main; sys.exit(main({words}))")
    assert (done.returncode, json.loads(done.stdout)["steps"]) == (ExitCode.FINISHED, 2)
    assert "stepbus_orchestrator.run.run" in modules
    assert not modules & LIBRARIES


def test_what_every_participant_loads_is_little_of_the_standard_library():
    _, modules = loaded_by("import stepbus_participant")
    assert "stepbus_participant.session.step_loop" in modules
    assert not modules & (LIBRARIES | {"argparse", "difflib", "logging", "subprocess", "zenoh"})
