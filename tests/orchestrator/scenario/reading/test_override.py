from __future__ import annotations

import sys

import pytest
from support.runs.scenario import TWO_LINK, load_text, problem_of, write

from stepbus_orchestrator.scenario.override import named_from_here


def params(scenario):
    return scenario.participant("controller").params


@pytest.mark.parametrize(
    ("settings", "kp"),
    [
        (["controller.params.kp=80"], 80),
        (["participants.controller.params.kp=80"], 80),
        (["controller.params.kp=1", "controller.params.kp=2"], 2),
        (["controller.params.kp=[1e-3, {a: b=c}, '5']"], [0.001, {"a": "b=c"}, "5"]),
        (["controller.params.kp=[1, 2]", "controller.params.kp.1=3"], [1, 3]),
        (["controller.params.kp=null"], None),
    ],
)
def test_a_setting_replaces_one_value_by_yaml(tmp_path, settings, kp):
    expected = {"law": "pd"} if kp is None else {"law": "pd", "kp": kp}
    assert params(load_text(tmp_path, TWO_LINK, *settings)) == expected


def test_settings_of_the_scenario_itself_of_lists_and_of_maps_that_may_be_left_out(tmp_path):
    scenario = load_text(
        tmp_path, TWO_LINK, "duration=2s", "bus.transport=tcp", "plant.exec.2=exit",
        "plant.params.noise.position=0.1",
    )  # fmt: skip
    assert (scenario.steps, scenario.bus.transport) == (400, "tcp")
    assert scenario.participant("plant").exec == ("python", "-c", "exit")
    assert scenario.participant("plant").params == {"noise": {"position": 0.1}}
    assert load_text(tmp_path, TWO_LINK, "duration=null").steps is None


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("seed", "write KEY=VALUE"),
        ("controler.params.kp=1", "'controler'; did you mean 'controller'?"),
        ("participants.controler.every=1", "'controler'; did you mean 'controller'?"),
        ("plant.inputs.comand.delay=1", "'comand'; did you mean 'command'?"),
        ("controller.params.kp.x=1", "kp is 100 and has no keys"),
        ("plant.exec.7=x", "no index '7'; the list has 3 values"),
        (f"plant.exec.{'9' * 5000}=x", "the list has 3 values"),
        ("seed=[1,", "not YAML: "),
        ("plant.evry=2", "participants.plant.evry: unknown key"),
        ("plant.every=0", "participants.plant.every: must be an integer of at least 1"),
    ],
)
def test_a_setting_that_cannot_be_is_named(tmp_path, setting, message):
    problem = problem_of(tmp_path, TWO_LINK, setting)
    assert problem.startswith(f"--set {setting}: ")
    assert message in problem


CLASS = "from stepbus import Participant\nclass Other(Participant): pass\n"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        *((name, "../here/same.py") for name in ("same.py", "./same.py", "../here/same.py")),
        ("other.py", "other.py"),
    ],
)
def test_a_file_in_a_setting_is_that_of_the_current_folder_or_else_of_the_scenario(
    tmp_path, monkeypatch, given, expected
):
    for name in ("here/same.py", "arm/same.py", "arm/other.py"):
        write(tmp_path, CLASS, name)
    monkeypatch.chdir(tmp_path / "here")
    setting = named_from_here(f"controller.participant={given}:Other")
    spec = load_text(tmp_path / "arm", TWO_LINK, setting).participant("controller")
    assert spec.participant == f"{expected}:Other"


@pytest.mark.parametrize("text", ["a=1", "a", "a=two_link", "a=[1,", "a=sine # no file", "a=0.5"])
def test_a_setting_without_files_keeps_its_text(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "", "two_link")
    assert named_from_here(text) == text


def test_the_interpreter_of_an_environment_keeps_its_path(tmp_path):
    write(tmp_path, "", "venv/pyvenv.cfg")
    python = tmp_path / "venv/bin/python"
    python.parent.mkdir()
    python.symlink_to(sys.executable)
    setting = f"plant.exec=[{python}, -c, pass]"
    assert load_text(tmp_path, TWO_LINK, setting).participant("plant").exec[0] == str(python)
