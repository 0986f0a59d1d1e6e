"""`stepbus validate` checks the parameters of every participant that declares them."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from support.runs.scenario import load_text, problem_of, problems_of, write

import stepbus
from stepbus_orchestrator import cli
from stepbus_orchestrator.scenario.program import participant_classes

SCENARIO = """\
name: own
step: 5ms
participants:
  own:
    participant: {participant}
    params: {params}
"""
OWN = "from stepbus import Participant\nclass Own(Participant): pass\n"
PARAMS = """\
from typing import Literal
from stepbus import Settings
from stepbus.params import Finite, Positive

class Params(Settings):
    gain: Positive
    mode: Literal["soft", "hard"] = "soft"
    lower: Finite = 0.0
    upper: Finite = 1.0

    def problems(self):
        if self.lower > self.upper:
            yield ("lower",), f"is above upper, {self.upper:g}"
"""


def scenario(params, participant="main.py:Own"):
    return SCENARIO.format(participant=participant, params=params)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("plant.params.sense=[positoin]", "sense[0]: must be position, velocity or effort … did you mean 'position'"),
        ("plant.params.jonts=[joint1]", "jonts: unknown key 'jonts'; did you"),
        ("plant.params.world=wrld.yaml", "world: file 'wrld.yaml' not found"),
        ("controller.params.law=pidd", "law: must be computed_torque, pd … did you mean 'pid'"),
        ("controller.params=true", ": must be a map, not true"),
        ("mission.params.task=sinus", "task: must be csv, sine, step … did you mean 'sine'"),
        ("mission.params.target=1", 'target: applies only with task step'),
        ("mission.params.amplitude=[1]", 'amplitude: has 1 numbers for 2 joints'),
    ],
)  # fmt: skip
def test_a_setting_of_a_service_is_checked_with_its_place(capsys, setting, message):
    assert cli.main(["validate", "two_link", "--set", setting]) == 2
    name, dot = setting.partition(".")[0], "" if message.startswith(":") else "."
    place, *words = message.split(" … ")
    said = capsys.readouterr().err
    assert f"--set {setting}: participants.{name}.params{dot}{place}" in said
    assert [word for word in words if word not in said] == []


def test_the_world_file_is_checked_too(tmp_path):
    write(tmp_path, "bodies:\n  arm: {urdf: arm.urdf, fixed: true}\n", "world.yaml")
    text = scenario("{world: world.yaml}", "stepbus_plant:Plant")
    urdf, fixed = (row.rpartition("world.yaml:")[2] for row in problems_of(tmp_path, text))
    assert urdf.startswith("2: bodies.arm.urdf: file 'arm.urdf' not")
    assert fixed.endswith("did you mean 'fixed_base'?")


@pytest.mark.parametrize(
    ("files", "participant"),
    [
        ({"main.py": OWN + PARAMS}, "main.py:Own"),
        ({"main.py": OWN + "from gains import Params\n", "gains.py": PARAMS}, "main.py:Own"),
        ({"arm.py": OWN + PARAMS}, "arm:Own"),
        ({"arm/__init__.py": OWN + "from .gains import Params\n", "arm/gains.py": PARAMS}, "arm:Own"),
        ({"arm/__init__.py": "", "arm/own.py": OWN + PARAMS}, "arm.own:Own"),
        ({"arm/own.py": OWN + "from gains import Params\n", "arm/gains.py": PARAMS}, "arm/own.py:Own"),
    ],
)  # fmt: skip
def test_a_class_of_the_scenarios_folder_is_checked(tmp_path, files, participant):
    for name, text in files.items():
        write(tmp_path, text, name)
    assert load_text(tmp_path, scenario("{gain: 2}", participant)).participants[0].params == {
        "gain": 2
    }
    found = problems_of(tmp_path, scenario("{gain: -1, mode: sft}", participant))
    gain, mode = (row.removeprefix("scenario.yaml:6: participants.own.params.") for row in found)
    assert gain == "gain: must be a number above 0, not -1"
    assert mode.endswith("did you mean 'soft'?")


def test_what_values_contradict_is_checked_in_the_users_own_code(tmp_path):
    write(tmp_path, OWN + PARAMS, "main.py")
    problem = problem_of(tmp_path, scenario("{gain: 1, lower: 3}"))
    assert problem.endswith("own.params.lower: is above upper, 1")


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import no_such_module", 'cannot import main.py'),
        ("print('hello')\nraise SystemExit(3)", 'main.py exits on import; move `raise'),
        ("import os; os._exit(1)", 'main.py:Own cannot be checked: its'),
        ("Own = 3", "'Own' in main.py is not a participant"),
        ("class Own: pass", "'Own' in main.py is not a participant"),
        ("del Own", "no class 'Own' in main.py"),
        (f"{OWN.replace('Own', 'Owm')}del Own", "no class 'Own' in main.py; did you mean"),
        (f"{OWN.replace('Own', 'Controller')}del Own", "no class 'Own' in main.py; known"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("params", ["{gain: 1}", "{}"])
def test_a_class_that_is_none_is_a_problem_and_never_a_traceback(
    tmp_path, capsys, code, reason, params
):
    write(tmp_path, f"{OWN}{code}\n", "main.py")
    write(tmp_path, scenario(params))
    assert cli.main(["validate", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert f"participants.own.participant: {reason}" in said
    assert "Traceback" not in said


def test_a_class_that_is_none_ends_a_run_with_the_same_words(tmp_path):
    write(tmp_path, OWN, "main.py")
    path = write(tmp_path, scenario("{}", "main.py:Ow"))
    for alone in (False, True):
        result = stepbus.run(path, out=tmp_path / str(alone), in_process=alone)
        assert (result.exit_code, result.participant) == (3, "own")
        assert "did you mean 'Own'?" in result.reason


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("participant: mian.py:Own", "participant: no file 'mian.py' in "),
        ("participant: mian.py:Own", "; did you mean 'main.py'?"),
        ("participant: stepbus_plnat:Plant", "no Python module 'stepbus_plnat'"),
        ("participant: stepbus_plnat:Plant", "; did you mean 'stepbus_plant'?"),
        ("participant: main.py", "not 'main.py'"),
        ("participant: main.py:Own\n    exec: [python, main.py]", 'but main.py:Own is a class'),
        ("participant: main.py:Own\n    bridge: json", 'but main.py:Own is a class'),
        ("every: 2", "needs either 'participant'"),
    ],
)  # fmt: skip
def test_what_a_participant_is_is_said_once_and_right(tmp_path, rows, message):
    write(tmp_path, OWN, "main.py")
    text = scenario("{}").replace("participant: main.py:Own", rows)
    assert any(message in row for row in problems_of(tmp_path, text))


def test_the_nearer_one_of_class_and_program_counts(tmp_path):
    write(tmp_path, OWN, "main.py")
    write(tmp_path, scenario("{}"), "base.yaml")
    top = "extends: base.yaml\nparticipants: {own: {exec: [python, main.py]}}\n"
    spec = load_text(tmp_path, top).participants[0]
    assert (spec.participant, spec.exec) == ("", ("python", "main.py"))
    spec = load_text(tmp_path, top, "own.participant=main.py:Own").participants[0]
    assert (spec.participant, spec.exec) == ("main.py:Own", ())


def test_the_users_code_does_not_run_in_the_orchestrator(tmp_path, capfd):
    write(
        tmp_path,
        f"import sys\nprint('ran')\nsys.modules['stepbus_spy'] = sys\n{OWN}{PARAMS}",
        "main.py",
    )
    load_text(tmp_path, scenario("{gain: 1}"))
    assert "stepbus_spy" not in sys.modules
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("text", ["", "Params = 3\n", "class Params: pass\n"])
def test_a_class_beside_which_nothing_is_declared_takes_any_parameters(tmp_path, text):
    write(tmp_path, OWN + text, "main.py")
    assert load_text(tmp_path, scenario("{anything: [1, 2]}")).participants[0].params


HEAVY = {"pybullet", "pinocchio", "cv2", "ompl", "scipy", "numpy", "ruamel.yaml", "matplotlib"}


def test_the_parameters_of_a_service_load_nothing_heavy():
    names = [name.rpartition(":")[0] for name in participant_classes()]
    code = f"import {', '.join(names)}\nimport json, sys\nprint(json.dumps(list(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert HEAVY & set(json.loads(done.stdout)) == set()


@pytest.mark.parametrize("alone", [False, True])
def test_a_file_that_is_called_as_a_module_of_python_is_another_one(tmp_path, alone):
    source = (
        "import signal\nfrom stepbus import Event, Participant\n"
        "class Own(Participant):\n"
        "    def update(self, step):\n"
        "        return {'event': Event(level='info', text=str(signal.SIGINT))}\n"
    )
    write(tmp_path, source, "signal.py")
    row = "participant: signal.py:Own\n    outputs: {event: Event/1}"
    text = scenario("{}").replace("participant: main.py:Own", row) + "duration: 20ms\n"
    result = stepbus.run(write(tmp_path, text), out=tmp_path / "out", in_process=alone)
    assert result.exit_code == 0, result.reason
