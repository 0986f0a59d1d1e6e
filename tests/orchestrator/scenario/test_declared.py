"""`stepbus validate` checks the parameters of every participant that declares them."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec

import pytest
from support.runs.scenario import load_text, problem_of, problems_of, write

from stepbus_orchestrator import cli
from stepbus_orchestrator.scenario.packages import participant_modules

SCENARIO = """\
name: own
step: 5ms
participants:
  own:
    exec: [python, {exec}]
    params: {params}
"""
PARAMS = """\
from typing import Literal
from stepbus import Finite, Positive, Settings

class Params(Settings):
    gain: Positive
    mode: Literal["soft", "hard"] = "soft"
    lower: Finite = 0.0
    upper: Finite = 1.0

    def problems(self):
        if self.lower > self.upper:
            yield ("lower",), f"is above upper, {self.upper:g}"
"""


def scenario(params, exec_="main.py"):
    return SCENARIO.format(exec=exec_, params=params)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("plant.params.sense=[positoin]", "sense[0]: must be effort, position or velocity, not 'positoin'; did you mean 'position'?"),
        ("plant.params.jonts=[joint1]", "jonts: unknown key 'jonts'; did you mean 'joints'?"),
        ("plant.params.world=wrld.yaml", "world: no file 'wrld.yaml'"),
        ("controller.params.law=pidd", "law: must be computed_torque, pd, pd_gravity, pid or module:Class, not 'pidd'; did you mean 'pid'?"),
        ("controller.params=true", ": must be a map, not true"),
        ("mission.params.task=sinus", "task: must be csv, sine, step, waypoints or module:Class, not 'sinus'; did you mean 'sine'?"),
        ("mission.params.target=1", "target: belongs to task step; task is 'sine'"),
        ("mission.params.amplitude=[1]", "amplitude: has 1 numbers, not 2 (joint1, joint2)"),
    ],
)  # fmt: skip
def test_a_setting_of_a_service_is_checked_with_its_place(capsys, setting, message):
    assert cli.main(["validate", "two_link", "--set", setting]) == 2
    name, dot = setting.partition(".")[0], "" if message.startswith(":") else "."
    assert f"--set {setting}: participants.{name}.params{dot}{message}" in capsys.readouterr().err


def test_the_world_file_is_checked_too(tmp_path):
    write(tmp_path, "bodies:\n  arm: {urdf: arm.urdf, fixed: true}\n", "world.yaml")
    text = scenario("{world: world.yaml}", "-m, stepbus_plant")
    assert [row.rpartition("world.yaml:")[2] for row in problems_of(tmp_path, text)] == [
        f"2: bodies.arm.urdf: no file 'arm.urdf' ({tmp_path}/arm.urdf)",
        "2: bodies.arm.fixed: unknown key 'fixed'; did you mean 'fixed_base'?",
    ]


@pytest.mark.parametrize(
    ("files", "exec_"),
    [
        ({"main.py": PARAMS}, "main.py"),
        ({"main.py": "from gains import Params\n", "gains.py": PARAMS}, "main.py"),
        ({"main.py": "from gains import Gains as Params\n", "gains.py": PARAMS.replace("Params", "Gains")}, "main.py"),
        ({"arm.py": PARAMS}, "-m, arm"),
        ({"arm/__init__.py": "", "arm/__main__.py": "", "arm/params.py": PARAMS}, "-m, arm"),
        ({"arm/__init__.py": "from .gains import Params\n", "arm/__main__.py": "", "arm/gains.py": PARAMS}, "-m, arm"),
    ],
)  # fmt: skip
def test_a_class_of_the_scenarios_folder_is_found_and_checked(tmp_path, files, exec_):
    for name, text in files.items():
        write(tmp_path, text, name)
    assert load_text(tmp_path, scenario("{gain: 2}", exec_)).participants[0].params == {"gain": 2}
    found = problems_of(tmp_path, scenario("{gain: -1, mode: sft}", exec_))
    assert [row.removeprefix("scenario.yaml:6: participants.own.params.") for row in found] == [
        "gain: must be above 0, not -1",
        "mode: must be hard or soft, not 'sft'; did you mean 'soft'?",
    ]


def test_what_values_contradict_is_checked_in_the_users_own_code(tmp_path):
    write(tmp_path, PARAMS, "main.py")
    assert problem_of(tmp_path, scenario("{gain: 1, lower: 3}")) == (
        "scenario.yaml:6: participants.own.params.lower: is above upper, 1"
    )


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("print('hello')\nraise SystemExit(3)", "SystemExit: 3"),
        ("import os; os._exit(1)", "Command"),
    ],
)
def test_a_program_that_cannot_be_imported_is_a_problem_and_never_a_traceback(
    tmp_path, code, reason
):
    write(tmp_path, f"{code}\n{PARAMS}", "main.py")
    found = problem_of(tmp_path, scenario("{gain: 1}"))
    assert "participants.own.params: " in found
    assert f"main.py cannot be imported to check them: {reason}" in found


def test_the_users_code_does_not_run_in_the_orchestrator(tmp_path, capfd):
    write(
        tmp_path, f"import sys\nprint('ran')\nsys.modules['stepbus_spy'] = sys\n{PARAMS}", "main.py"
    )
    load_text(tmp_path, scenario("{gain: 1}"))
    assert "stepbus_spy" not in sys.modules
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("text", ["", "Params = 3\n", "class Params: pass\n"])
def test_a_program_that_declares_nothing_takes_any_parameters(tmp_path, text):
    write(tmp_path, text, "main.py")
    assert load_text(tmp_path, scenario("{anything: [1, 2]}")).participants[0].params


HEAVY = {"pybullet", "pinocchio", "cv2", "ompl", "scipy", "numpy", "ruamel.yaml", "matplotlib"}


def test_the_parameters_of_a_service_load_nothing_heavy():
    services = participant_modules()
    names = [f"{name}.params" if find_spec(f"{name}.params") else name for name in services]
    code = f"import {', '.join(names)}\nimport json, sys\nprint(json.dumps(list(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert HEAVY & set(json.loads(done.stdout)) == set()
