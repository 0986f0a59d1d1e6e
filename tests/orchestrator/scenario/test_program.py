from __future__ import annotations

import sys

import pytest
from support.runs.scenario import TWO_LINK, changed, load_text, problem_of, write

from stepbus_orchestrator.scenario.program import command


def executed(folder, exec_):
    """Return the problem of a scenario whose mission has this `exec`, or None."""
    text = changed("[python, -c, pass]\n    every", f"{exec_}\n    every")
    try:
        load_text(folder, text)
    except ValueError as exc:
        return str(exc)
    return None


def test_python_stepbus_and_programs_on_the_path_become_commands(tmp_path):
    assert command(("python", "a.py"), tmp_path) == (sys.executable, "a.py")
    assert command(("stepbus", "replay"), tmp_path) == (
        sys.executable, "-P", "-m", "stepbus_orchestrator.cli", "replay",
    )  # fmt: skip
    assert command(("sh", "-c"), tmp_path)[0].endswith("/sh")


def test_a_program_of_the_folder_comes_before_path(tmp_path):
    own = write(tmp_path, "#!/bin/sh\n", "sh")
    own.chmod(0o755)
    assert command(("sh",), tmp_path) == (str(own),)


@pytest.mark.parametrize(
    ("exec_", "message"),
    [
        ("[no_such_program]", "no program 'no_such_program' on PATH"),
        ("[./missing]", "no program './missing' in "),
        ("[./plain.sh]", "'./plain.sh' is not executable"),
        ("[python, mian.py]", "did you mean 'main.py'?"),
        ("[python, -m, no_such_module]", "no Python module 'no_such_module'"),
        ("[python, -m, json.no_such]", "no Python module 'json.no_such'"),
        ("[python, -m, '..']", "no Python module '..'"),
        ("[]", "needs either 'participant'"),
        ("['']", "needs the name of a program"),
        ("python main.py", "must be a list, not 'python main.py'"),
        ("[python, main.py, 5]", "put it in quotes"),
        ("", "needs either 'participant'"),
    ],
)
def test_a_program_that_cannot_be_started_is_named(tmp_path, exec_, message):
    write(tmp_path, "", "main.py")
    write(tmp_path, "", "plain.sh")
    assert message in executed(tmp_path, exec_)


@pytest.mark.parametrize(
    "exec_",
    ["[python, -m, json.tool]", "[python, -u, main.py]", "[python, -m, main]", "[python, -c, x]"],
)
def test_what_python_can_run_is_accepted(tmp_path, exec_):
    write(tmp_path, "", "main.py")
    assert executed(tmp_path, exec_) is None


def test_a_module_is_not_imported_to_be_found(tmp_path):
    write(tmp_path, "raise SystemExit\n", "own/__init__.py")
    write(tmp_path, "", "own/law.py")
    assert executed(tmp_path, "[python, -m, own.law]") is None


def test_the_program_of_a_setting_is_checked_too(tmp_path):
    problem = problem_of(tmp_path, TWO_LINK, "plant.exec=[nope]")
    assert problem.startswith("--set plant.exec=[nope]:")
