from __future__ import annotations

import pytest
from support.runs.scenario import changed, problem_of, write

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.scenario.load import load


@pytest.fixture
def base(tmp_path):
    write(tmp_path)
    return tmp_path


def on_top(folder, text):
    return load(write(folder, f"extends: scenario.yaml\n{text}", "top.yaml"))


def test_maps_are_merged_lists_replaced_and_null_removes(base):
    rows = "controller: {params: {kp: null, ki: 0.02}}, plant: {exec: [python, -c, '1']}"
    scenario = on_top(base, f"duration: null\nparticipants: {{{rows}}}")
    assert scenario.participant("controller").params == {"law": "pd", "ki": 0.02}
    assert scenario.participant("controller").outputs
    assert scenario.participant("plant").exec == ("python", "-c", "1")
    assert (scenario.steps, scenario.step_ns) == (None, 5_000_000)


def test_bases_may_have_bases(base):
    write(base, "extends: scenario.yaml\nseed: 3\n", "middle.yaml")
    write(base, "extends: middle.yaml\nname: top\n", "top.yaml")
    scenario = load(base / "top.yaml")
    assert (scenario.name, scenario.seed, scenario.step_ns) == ("top", 3, 5_000_000)


def test_a_problem_names_the_file_it_stands_in(base):
    write(base, "extends: scenario.yaml\nseeed: 3\n", "middle.yaml")
    write(base, "extends: middle.yaml\n\nwindow: 0\n", "scenario2.yaml")
    with pytest.raises(ScenarioError) as caught:
        load(base / "scenario2.yaml")
    seed, window = str(caught.value).splitlines()
    assert seed.startswith("middle.yaml:2: seeed: ")
    assert window.startswith("scenario2.yaml:3: window: ")


def test_a_circle_is_refused(tmp_path):
    write(tmp_path, "extends: scenario.yaml\n", "b.yaml")
    problem = problem_of(tmp_path, "extends: b.yaml\n")
    assert problem.endswith("scenario.yaml → b.yaml → scenario.yaml")


def test_a_base_in_another_folder_brings_its_files(tmp_path):
    write(tmp_path, "", "common/gains.csv")
    write(tmp_path, "", "common/main.py")
    text = changed("law: pd", "law: pd, own: [{table: gains.csv}]")
    write(tmp_path / "common", text.replace("[python, -c, pass]", "[python, main.py]"))
    write(tmp_path / "mine", "extends: ../common\nname: mine\n")
    scenario = load(tmp_path / "mine")
    assert scenario.participant("controller").params["own"] == [{"table": "../common/gains.csv"}]
    assert scenario.participant("plant").exec == ("python", "../common/main.py")
    assert list(scenario.files) == ["../common/gains.csv", "../common/main.py"]


def test_a_scenario_that_ships_is_a_base_by_its_name(tmp_path):
    scenario = load(write(tmp_path, "extends: two_link/pd\nname: mine\n"))
    shipped = "package://stepbus_scenarios/two_link"
    assert scenario.participant("plant").params == {"world": f"{shipped}/world.yaml"}
    assert scenario.participant("controller").params["model"] == f"{shipped}/two_link.urdf"
    assert list(scenario.files) == []


def test_a_problem_in_another_folder_names_the_base_as_it_is_named(tmp_path):
    write(tmp_path / "common", changed("5ms", "5"))
    problem = problem_of(tmp_path / "mine", "extends: ../common/scenario.yaml\n")
    assert problem.startswith("../common/scenario.yaml:2: step:")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("two_lnk/pd", "scenario; did you mean 'two_link/pd'?"),
        ("pd_bse.yaml", "did you mean 'pd_base.yaml'?"),
        ("[a, b]", "must name a scenario, not a list of 2"),
    ],
)
def test_a_base_that_is_not_there_is_answered_with_the_nearest(tmp_path, name, message):
    write(tmp_path, "", "pd_base.yaml")
    assert problem_of(tmp_path, f"extends: {name}\n").endswith(message)
