from __future__ import annotations

import pytest
from support.runs.scenario import TWO_LINK, changed, load_text, problem_of, write

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.plugins import all_points
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.locate import builtin_names, locate, package_url
from stepbus_orchestrator.scenario.model import BusSpec, Deadlines
from stepbus_orchestrator.scenario.ports import OutputSpec
from stepbus_participant import is_installed


def test_what_is_not_set_has_its_default(tmp_path):
    scenario = load_text(tmp_path)
    plant = scenario.participant("plant")
    assert (scenario.seed, scenario.window, scenario.batch) == (0, 64, 32)
    assert scenario.bus == BusSpec(transport="unix", port=None, low_latency=None)
    assert plant.deadlines == Deadlines(spawn_s=20, join_s=10, ready_s=30, step_s=3, stop_s=3)
    assert (plant.every, plant.params) == (1, {})


def test_every_key_is_read(tmp_path):
    text = changed(
        "participants:",
        "seed: 7\nwindow: 8\nbatch: 2\nbus: {transport: tcp, port: 7447}\nparticipants:",
    )
    text = text.replace("every: 4", "every: 4\n    step_timeout: 2min\n    join_timeout: 500ms")
    text = text.replace("JointReference/1}", "{type: JointReference/1, bulk: true}}")
    scenario = load_text(tmp_path, text)
    mission = scenario.participant("mission")
    assert (scenario.seed, scenario.window, scenario.batch) == (7, 8, 2)
    assert scenario.bus == BusSpec(transport="tcp", port=7447)
    assert mission.deadlines == Deadlines(step_s=120.0, join_s=0.5)
    assert mission.outputs == {"reference": OutputSpec(type="JointReference/1", bulk=True)}


def test_a_window_of_one_has_a_batch_of_one(tmp_path):
    assert load_text(tmp_path, TWO_LINK, "window=1").batch == 1


def test_an_absent_map_is_an_empty_map(tmp_path):
    text = changed("params: {law: pd, kp: 100}", "params:")
    assert load_text(tmp_path, text).participant("controller").params == {}


def test_numbers_are_those_of_yaml_1_2(tmp_path):
    text = changed("kp: 100", "a: 1e-3, b: 010, c: on, d: 1:30, e: 2020-01-01, f: 0x10, g: .5")
    params = load_text(tmp_path, text).participant("controller").params
    assert params == {
        "law": "pd", "a": 0.001, "b": 10, "c": "on", "d": "1:30", "e": "2020-01-01", "f": 16,
        "g": 0.5,
    }  # fmt: skip


def test_a_folder_stands_for_its_scenario_yaml(tmp_path):
    path = write(tmp_path)
    assert load(tmp_path).file == load(path).file == path.resolve()


@pytest.fixture
def acme(tmp_path, monkeypatch):
    """A package that declares a participant and scenarios of its own."""
    site = tmp_path / "site"
    folder = site / "acme_robots/scenarios/acme"
    write(site / "acme_robots", "raise SystemExit('imported')\n", "__init__.py")
    write(folder)
    write(folder, "extends: scenario.yaml\nname: pd\n", "pd.yaml")
    write(folder, "gravity: [0, 0, -9.81]\n", "world.yaml")
    write(site / "acme-1.0.dist-info", "Name: acme\nVersion: 1.0\n", "METADATA")
    groups = "[stepbus.participants]\narm = acme_robots.arm:Arm\n[stepbus.scenarios]\na = acme_robots.scenarios\nb = acme_gone\n"
    write(site / "acme-1.0.dist-info", groups, "entry_points.txt")
    monkeypatch.syspath_prepend(site)
    all_points.cache_clear()
    yield
    monkeypatch.undo()
    all_points.cache_clear()


@pytest.mark.usefixtures("acme")
def test_scenarios_of_installed_packages_are_found_by_name_without_an_import():
    assert set(builtin_names()) >= {"acme", "acme/pd", "two_link", "two_link/pd"}
    assert (load("acme").name, load("acme/pd").name) == ("arm", "pd")
    assert package_url(locate("acme/pd")) == "package://acme_robots/scenarios/acme/pd.yaml"


@pytest.mark.usefixtures("acme")
def test_no_folder_replaces_a_package_that_declares_participants():
    assert is_installed("acme_robots.arm")
    assert not is_installed("acme")


@pytest.mark.parametrize("name", ["store", "baxter/round_trip", "store/truth"])
def test_a_scenario_of_a_package_that_is_not_installed_says_what_installs_it(monkeypatch, name):
    monkeypatch.setattr("stepbus_orchestrator.scenario.locate.scenario_folders", dict)
    with pytest.raises(ScenarioError, match=f"^{name}: that scenario .*run `make robots`$"):
        load(name)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("two_lnk", r"give the path of your own, .*; did you mean 'two_link'\?"),
        ("nope.yaml", r"^nope\.yaml: no such file or folder"),
        (".", r"the folder has no scenario\.yaml"),
    ],
)
def test_a_name_of_no_scenario_is_answered_with_what_to_give(tmp_path, monkeypatch, name, sentence):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ScenarioError, match=sentence):
        load(name)


@pytest.mark.parametrize(
    ("text", "place", "word"),
    [
        ("", "", "is empty"),
        ("- a\n", "", "is not a map"),
        ("a: 1\nb: [1\n", ":3", "brackets"),
        ("[" * 10_000, "", "nested too deeply"),
        ("- " * 10_000, "", "nested too deeply"),
        ("kp: &x [*x]", "", "nested too deeply"),
        ("a: 1\n" * 300_000, "", "more than 1000000 characters"),
        ("a: 1\n---\nb: 2\n", ":2", "another document"),
        ("types: {Arm/1: {force: float[3]}}\n", ":1", "and quotes"),
        ("a:\n\tb: 3\n", ":2", "check the indentation"),
    ],
)
def test_a_file_that_is_no_scenario_is_refused(tmp_path, text, place, word):
    problem = problem_of(tmp_path, text)
    assert problem.startswith(f"scenario.yaml{place}: ")
    assert word in problem


def test_a_file_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "scenario.yaml").write_bytes(b"name: \xff")
    with pytest.raises(ScenarioError, match=r"is not UTF-8 text \(byte 6\)"):
        load(tmp_path)


def test_aliases_of_aliases_do_not_fill_the_memory(tmp_path):
    rows = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    assert "has more than" in problem_of(tmp_path, "\n".join(["a0: &a0 1", *rows]))
