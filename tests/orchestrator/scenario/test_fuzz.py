"""Whatever a scenario says: it is valid, or every problem has a sentence; never a traceback."""

from __future__ import annotations

import copy
import io

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML
from support.properties import examples
from support.runs.scenario import TWO_LINK, plain, write

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario

SCALARS = [
    None, True, False, -1, 0, 1.5, 1e400, float("nan"), 2**63, "", ".", "a.b", "5ms", "unix",
    "first", "\x00", "x" * 300,
]  # fmt: skip
MAPS = [{"a": None}, {"from": []}, {"type": {}}, {"params": {"x": "../"}}, {"": ""}]
VALUES = [*SCALARS, [], {}, [None], [[]], *MAPS]
ODD = st.sampled_from(VALUES)
ENCODABLE = st.characters(codec="utf-8")
FUZZ = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(15)
)
SERVICES = """\
name: services
step: 5ms
participants:
  plant:
    participant: stepbus_plant:Plant
    publishes: first
    outputs: {joint_state: JointState/1, rgb: {type: Image/1, bulk: true}}
    on_fault: stop
    params:
      world: package://stepbus_scenarios/two_link/world.yaml
      sense: [position]
      noise: {position: 0.1}
      effort: {joint1: 3}
      poses_period: 10ms
      stock: {seed: 3, missing: [cola]}
      script: [{at: 3s, jam: joint1}, {at: 0s, camera: wrist, off: true}]
  mission:
    exec: [python, -m, json.tool]
    inputs: {joint_state: {from: plant.joint_state, delay: 1, type: JointState/1}}
    outputs: {reference: JointReference/1}
    on_fault: {hold: 1s, keep: 0s, safe: {reference: {position: [0], velocity: [0], acceleration: [0]}}}
    bridge: {format: json, describe: {reference: {names: [joint1]}}}
    params:
      task: waypoints
      joints: [joint1]
      waypoints: [{time: 0, position: 1}, {time: 2, position: [3]}, {time: 5, position: {joint1: 1}}]
  sine:
    participant: stepbus_mission:Mission
    params: {task: sine, joints: [a, b], amplitude: 1, omega: [1, 2], phase: {a: 0, b: 1}}
  pick:
    participant: stepbus_scenarios.pick.mission:Pick
    params: {model: "package://stepbus_scenarios/pick/scara.urdf", joints: [a, b, c, d], base: base, tip: hand, cube: cube, goal: [0.3, 0.2, 0], force: 3}
  position:
    participant: stepbus_controller.position:PositionController
    params: {joints: [a]}
bus: {transport: tcp, port: 7447, low_latency: false}
faults: [kill plant at 3]
"""


def paths_of(data, above=()):
    """Yield the path of every value, also of maps and lists."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield (*above, key)
        if isinstance(value, dict | list):
            yield from paths_of(value, (*above, key))


def with_value(data, path, value):
    changed = copy.copy(data)
    changed[path[0]] = value if len(path) == 1 else with_value(data[path[0]], path[1:], value)
    return changed


BASES = {"two_link": plain(), "services": YAML(typ="safe", pure=True).load(SERVICES)}
PLACES = [(name, path) for name, data in BASES.items() for path in paths_of(data)]


def ends_well(path, overrides=()):
    try:
        return isinstance(load(path, overrides), Scenario)
    except ScenarioError as exc:
        return bool(exc.problems) and all(problem.message for problem in exc.problems)


def text_of(data):
    text = io.StringIO()
    YAML(typ="safe", pure=True).dump(data, text)
    return text.getvalue()


def test_the_scenario_of_all_services_is_valid(tmp_path):
    assert isinstance(load(write(tmp_path, SERVICES)), Scenario)


def hash_of(value):
    return VALUES.index(value) if value == value else len(VALUES)


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("value", VALUES, ids=lambda value: ascii(value)[:20])
def test_odd_values_in_every_place_end_in_a_scenario_or_in_problems(tmp_path, value):
    # A third of the places for each value, by its number: each place meets nine values or more.
    for name, path in PLACES[hash_of(value) % 3 :: 3]:
        assert ends_well(write(tmp_path, text_of(with_value(BASES[name], path, value)))), path


@FUZZ
@given(changes=st.lists(st.tuples(st.sampled_from(PLACES), ODD), min_size=2, max_size=4))
@example(changes=[(("two_link", ("participants", "controller", "params")), True)])
def test_values_of_any_kind_end_in_a_scenario_or_in_problems(tmp_path, changes):
    name = changes[0][0][0]
    data = BASES[name]
    for (base, path), value in changes:
        if base == name and path in set(paths_of(data)):
            data = with_value(data, path, value)
    assert ends_well(write(tmp_path, text_of(data)))


@FUZZ
@given(at=st.integers(0, len(TWO_LINK)), cut=st.integers(0, 30), put=st.text(ENCODABLE, max_size=4))
def test_broken_text_ends_in_a_scenario_or_in_problems(tmp_path, at, cut, put):
    assert ends_well(write(tmp_path, TWO_LINK[:at] + put + TWO_LINK[at + cut :]))


PARTS = st.sampled_from(
    ["plant", "participants", "params", "inputs", "exec", "0", "bus", "step", ""]
)


@FUZZ
@given(path=st.lists(PARTS | st.text(max_size=3), max_size=5), value=ODD)
@example(path=["controller", "params"], value=True)
@example(path=["controller", "inputs"], value=True)
@example(path=["plant", "outputs"], value=1e400)
def test_any_setting_ends_in_a_scenario_or_in_problems(tmp_path, path, value):
    assert ends_well(write(tmp_path), [f"{'.'.join(path)}={value}"])


@pytest.mark.parametrize("section", ["params", "inputs", "outputs"])
@pytest.mark.parametrize("value", ["true", "1e400", "[]", '""'])
def test_a_section_that_is_no_map_is_refused_in_one_sentence(tmp_path, section, value):
    with pytest.raises(ScenarioError) as caught:
        load(write(tmp_path), [f"mission.{section}={value}"])
    assert f"participants.mission.{section}: must be a map, not " in str(caught.value)
