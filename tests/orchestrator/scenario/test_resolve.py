from __future__ import annotations

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.properties import examples
from support.runs.scenario import TWO_LINK, changed, load_text, wiring, write

from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.resolve import resolved
from stepbus_participant.parameters import parse_yaml, read_yaml

RESOLVED = """\
name: arm
step: 5ms
duration: 10s
seed: 0
participants:
  plant:
    exec: [python, -c, pass]
    every: 1
    publishes: first
    inputs: {command: controller.command}
    outputs: {joint_state: JointState/1}
  controller:
    exec: [python, -c, pass]
    every: 1
    publishes: last
    inputs: {joint_state: plant.joint_state, reference: mission.reference}
    outputs: {command: JointCommand/1, status: ControllerStatus/1}
    params: {law: pd, kp: 100}
  mission:
    exec: [python, -c, pass]
    every: 4
    publishes: last
    inputs:
      joint_state: {from: plant.joint_state, delay: 1}
    outputs: {reference: JointReference/1}
"""


def test_the_resolved_scenario_says_all_that_determines_the_result(tmp_path):
    assert resolved(load_text(tmp_path)) == RESOLVED


def test_it_loads_as_an_equal_scenario(tmp_path):
    scenario = load_text(tmp_path, changed("delay: 1", "delay: 1, type: JointState/1"))
    again = load(write(tmp_path / "again", resolved(scenario)))
    assert again == scenario
    assert resolved(again) == resolved(scenario)


def test_what_changes_no_result_is_left_out(tmp_path):
    settings_ = ("window=2", "bus.transport=tcp", "plant.step_timeout=9s", "bus.low_latency=false")
    assert resolved(load_text(tmp_path, TWO_LINK, *settings_)) == RESOLVED


def test_what_it_extends_is_merged_in(tmp_path):
    write(tmp_path)
    top = write(tmp_path, "extends: scenario.yaml\n", "top.yaml")
    assert resolved(load(top)) == RESOLVED


def test_the_order_of_participants_is_kept(tmp_path):
    text = wiring("b.x <- a.o -1\n c.x <- a.o -1").replace("  a:", "  z: {exec: [sh]}\n  a:")
    assert list(load(write(tmp_path, resolved(load_text(tmp_path, text)))).participants) == list(
        load_text(tmp_path, text).participants
    )


def test_a_value_that_stands_in_two_places_is_written_twice(tmp_path):
    scenario = load_text(tmp_path, changed("kp: 100", "kp: &gains [1, 2], ki: *gains"))
    assert "params: {law: pd, kp: [1, 2], ki: [1, 2]}" not in resolved(scenario)
    assert "kp: [1, 2]\n      ki: [1, 2]\n" in resolved(scenario)


# A file name would be looked up, and a path outside of the folder be refused.
TEXTS = st.text(st.characters(blacklist_characters="/\0", blacklist_categories=("Cs",)))
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False)
    | TEXTS
    | st.sampled_from(["5ms", "on", "010", "0o7", "1e3", "~", "<<", "=", "2020-01-01", "a: b"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
    max_leaves=12,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(40))
@given(value=VALUES)
def test_any_parameter_survives_being_written(tmp_path, value):
    scenario = load_text(tmp_path)
    params = dict(scenario.participant("controller").params)
    scenario.participant("controller").params["kp"] = value
    file = write(tmp_path, resolved(scenario))
    again = load(file).participant("controller").params
    assert repr(again) == repr({**params, "kp": value})
    assert repr(parse_yaml("", file.read_text("utf-8"))) == repr(read_yaml(file, "").data)
