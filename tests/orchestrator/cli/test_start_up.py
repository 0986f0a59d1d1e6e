"""What is loaded before anything happens: each module more is a part of every start."""

import json
import subprocess
import sys

import pytest

from stepbus_orchestrator.errors import ExitCode

CLI = "stepbus_orchestrator.cli"
OVERVIEW = {
    *("stepbus_orchestrator", CLI, f"{CLI}.entry", f"{CLI}.overview", f"{CLI}.signals"),
    *(f"{CLI}.terminal", f"{CLI}.terminal.output", f"{CLI}.terminal.stdout_buffer"),
    *("stepbus_orchestrator.plugins", "stepbus_orchestrator.processes"),
}
SLOW = {"argparse", "ast", "dataclasses", "importlib.metadata", "inspect", "json", "logging"}
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


@pytest.mark.parametrize(
    ("option", "said"), [("--version", "stepbus "), ("--help", "usage: stepbus COMMAND")]
)
def test_the_version_and_the_overview_load_no_package_but_their_own(option, said):
    run = f"sys.argv = ['stepbus', '{option}']; from {CLI} import main; sys.exit(main())"
    done, modules = loaded_by(run)
    assert (done.returncode, done.stdout[: len(said)]) == (ExitCode.FINISHED, said)
    of_others = {name for name in modules if name.partition(".")[0] not in sys.stdlib_module_names}
    assert of_others <= OVERVIEW
    assert not modules & SLOW


def test_the_orchestrator_of_a_run_loads_no_library_of_its_participants(tmp_path):
    words = ["run", "two_link", "--set", "duration=10ms", "--json", "--no-report"]
    words += ["--out", str(tmp_path / "run")]
    done, modules = loaded_by(f"from {CLI} import main; sys.exit(main({words}))")
    assert (done.returncode, json.loads(done.stdout)["steps"]) == (ExitCode.FINISHED, 2)
    assert "stepbus_orchestrator.run.phases" in modules
    assert not modules & LIBRARIES


def test_what_every_participant_loads_is_little_of_the_standard_library():
    _, modules = loaded_by("import stepbus_participant")
    assert "stepbus_participant.session.step_loop" in modules
    assert not modules & (LIBRARIES | {"argparse", "difflib", "logging", "subprocess", "zenoh"})
