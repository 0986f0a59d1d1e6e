from __future__ import annotations

import pickle

import pytest
from support.runs.scenario import TWO_LINK, changed, load_text, problem_of, problems_of

from stepbus_orchestrator.errors import ScenarioError
from stepbus_schemas import WiringError

FIVE_PROBLEMS = {
    "2: step": "with a unit",
    "7: participants.plant.publishes": "'first'?",
    "12: participants.controller.inputs.joint_state": "'plant'?",
    "13: participants.controller.outputs.command": "JointCommand/9",
    "17: participants.mission.evry": "'every'?",
}


def test_all_problems_are_listed_at_once(tmp_path):
    text = (
        changed("joint_state: plant.joint_state", "joint_state: plnt.joint_state")
        .replace("5ms", "5")
        .replace("every: 4", "evry: 4")
        .replace("JointCommand/1", "JointCommand/9")
        .replace("publishes: first", "publishes: frist")
    )
    found = problems_of(tmp_path, text)
    assert len(found) == 5
    for line, (place, word) in zip(found, FIVE_PROBLEMS.items(), strict=True):
        assert line.startswith(f"scenario.yaml:{place}: ")
        assert word in line


def test_an_error_survives_a_way_between_processes(tmp_path):
    with pytest.raises(WiringError) as caught:
        load_text(tmp_path, TWO_LINK, "seed=-1")
    again = pickle.loads(pickle.dumps(caught.value))
    assert isinstance(again, ScenarioError)
    assert again.problems == caught.value.problems


MISTAKES = [
    ("name: arm\n", "", ": the key 'name' is missing"),
    ("name: arm", "name: my arm", ":1: name: … 1 to 64 letters"),
    ("name: arm", "name: 5", ":1: name: … 1 to 64 letters … not 5"),
    ("10s", "10.001s", ":3: duration: … 2000.2 steps of 5ms … 10s or 10005ms"),
    ("10s", "1ms", ":3: duration: … 0.2 steps of 5ms … nearest is 5ms"),
    ("10s", "10s\nwindow: 0", ":4: window: … at least 1, not 0"),
    ("10s", "10s\nwindow: true", ":4: window: … integer of at least 1, not true"),
    ("10s", "10s\nwindow: 8\nbatch: 5", ":5: batch: … half the window (8) … 4, not 5"),
    ("10s", "10s\nbus: tcp", ":4: bus: … map, not 'tcp'"),
    ("10s", "10s\nbus: {transport: udp}", ":4: bus.transport: … unix or tcp, not 'udp'"),
    ("10s", "10s\nbus: {port: 7447}", ":4: bus.port: … only for transport tcp"),
    ("10s", "10s\ncheckpoint: 3ms", ":4: checkpoint: … 0.6 steps of 5ms … nearest is 5ms"),
    ("every: 4", "on_late: fail", ":17: participants.mission.on_late: … only with real_time true"),
    ("10s", "10s\nreal_time: true", ":4: real_time: … participants.NAME.real_time"),
    ("10s", "10s\nexternal: true", ":4: external: … `start: external`"),
    ("10s", "10s\ntransport: tcp", ":4: transport: … belongs to `bus`"),
    ("every: 4", "external: true", ":17: participants.mission.external: … `start: external`"),
    ("every: 4", "window: 3", ":17: participants.mission.window: … at the top level"),
    ("every: 4", "delay: 3", ":17: participants.mission.delay: … belongs to `inputs`"),
    ("every: 4", "hold: 3s", ":17: participants.mission.hold: … belongs to `on_fault`"),
    ("every: 4", "every: 4ms", ":17: participants.mission.every: … at least 1, not '4ms'"),
    ("10s", "10s\nbus: {low_latency: 1}", ":4: bus.low_latency: … true or false, not 1"),
    ("10s", "10s\nstep: 1s", ":4: step: … duplicate key, first in line 2"),
    ("10s", "10s\n<<: {seed: 3}", ":4: '<<' … YAML 1.2"),
    ("kp: 100", "5: 1", ":14: participants.controller.params: … text, not 5"),
    ("kp: 100", "kp: !gain 5", ":14: participants.controller.params.kp: … tag !gain"),
    ("kp: 100", "kp: 99999999999999999999", ":14: participants.controller.params.kp: … 64 bits"),
    (
        "kp: 100",
        'kp: "\\ud800"',
        ":14: participants.controller.params.kp: … '\\ud800' is not a valid str",
    ),
    ("every: 4", "every: 0.5", ":17: participants.mission.every: … integer of at least 1, not 0.5"),
    ("every: 4", "step_timeout: 0s", ":17: participants.mission.step_timeout: … longer than 0"),
    ("every: 4", "params: [1]", ":17: participants.mission.params: … map, not a list"),
    ("delay: 1", "delay: -1", ":18: participants.mission.inputs.joint_state.delay: … 0, not -1"),
    ("delay: 1", "dely: 1", ":18: participants.mission.inputs.joint_state.dely: … 'delay'?"),
    ("from: plant.joint_state, ", "", ":18: participants.mission.inputs.joint_state: … 'from'"),
    (
        "{from: plant.joint_state, delay: 1}",
        "plant",
        ":18: participants.mission.inputs.joint_state: … PARTICIPANT.OUTPUT … not 'plant'",
    ),
    (
        "from: plant.joint_state",
        "from: plant.join_state",
        ":18: participants.mission.inputs.joint_state: … did you mean 'joint_state'?",
    ),
    (
        "from: plant.joint_state",
        "from: mission.reference",
        ":18: participants.mission.inputs.joint_state: … reads its own output",
    ),
    (
        "delay: 1",
        "delay: 1, type: Event/1",
        ":18: participants.mission.inputs.joint_state: … expects Event/1 … is JointState/1",
    ),
    ("JointReference/1", "{bulk: true}", ":19: participants.mission.outputs.reference: … 'type'"),
    (
        "outputs: {joint_state",
        "outputs: {j.s: Event/1, joint_state",
        ":9: participants.plant.outputs.j.s: … 1 to 64 letters",
    ),
    (
        "  mission:",
        "  window: {exec: [python, -c, pass]}\n  mission:",
        ":15: participants.window: … reserved name",
    ),
    ("  mission:", "  other:\n  mission:", ":15: participants.other: … 'participant' … 'exec'"),
]


@pytest.mark.parametrize(("old", "new", "words"), MISTAKES)
def test_a_mistake_is_told_with_its_place(tmp_path, old, new, words):
    place, *more = words.split(" … ")
    found = problem_of(tmp_path, changed(old, new))
    assert found.startswith(f"scenario.yaml{place}")
    assert [word for word in more if word not in found] == []


def test_a_scenario_needs_a_participant(tmp_path):
    problem = problem_of(tmp_path, "name: a\nstep: 5ms\nparticipants: {}\n")
    assert "scenario.yaml:3: participants: is empty" in problem


def test_both_sides_may_name_the_type(tmp_path):
    scenario = load_text(tmp_path, changed("delay: 1", "delay: 1, type: JointState/1"))
    assert scenario.participant("mission").inputs["joint_state"].type == "JointState/1"
