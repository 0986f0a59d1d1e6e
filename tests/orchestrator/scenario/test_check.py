from __future__ import annotations

import pickle

import pytest
from support.runs.scenario import TWO_LINK, changed, load_text, problem_of, problems_of

from stepbus_orchestrator.errors import ScenarioError
from stepbus_schemas import WiringError

FIVE_PROBLEMS = """\
scenario.yaml:2: step: must be a duration with a unit, e.g. 5ms, not 5
scenario.yaml:7: participants.plant.publishes: must be first or last, not 'frist'; \
did you mean 'first'?
scenario.yaml:12: participants.controller.inputs.joint_state: no participant 'plnt'; \
did you mean 'plant'?
scenario.yaml:13: participants.controller.outputs.command: \
unknown message type 'JointCommand/9'; known: JointCommand/1
scenario.yaml:17: participants.mission.evry: unknown key 'evry'; did you mean 'every'?"""


def test_all_problems_are_listed_at_once(tmp_path):
    text = (
        changed("joint_state: plant.joint_state", "joint_state: plnt.joint_state")
        .replace("5ms", "5")
        .replace("every: 4", "evry: 4")
        .replace("JointCommand/1", "JointCommand/9")
        .replace("publishes: first", "publishes: frist")
    )
    assert "\n".join(problems_of(tmp_path, text)) == FIVE_PROBLEMS


def test_an_error_survives_a_way_between_processes(tmp_path):
    with pytest.raises(WiringError) as caught:
        load_text(tmp_path, TWO_LINK, "seed=-1")
    again = pickle.loads(pickle.dumps(caught.value))
    assert isinstance(again, ScenarioError)
    assert again.problems == caught.value.problems


def test_no_more_problems_are_looked_for_than_anybody_reads(tmp_path):
    faults = ", ".join(f"kil plant at {step}" for step in range(20_000))
    with pytest.raises(ScenarioError) as caught:
        load_text(tmp_path, f"{TWO_LINK}faults: [{faults}]\n")
    assert len(caught.value.problems) == 100
    assert str(caught.value).endswith("\nthere may be more; fix these first")


MISTAKES = [
    ("name: arm\n", "", ": the key 'name' is missing"),
    (
        "name: arm",
        "name: my arm",
        (
            ":1: name: 'my arm' is not a valid name; use 1 to 64 letters, digits, '_' and '-', "
            "starting with a letter or digit"
        ),
    ),
    ("name: arm", "name: 5", ":1: name: must be text, not 5; put it in quotes"),
    (
        "10s",
        "10.001s",
        (
            ":3: duration: 10.001s is 2000.2 steps of 5ms, not a whole number; the nearest "
            "is 10s or 10005ms"
        ),
    ),
    ("10s", "1ms", ":3: duration: 1ms is 0.2 steps of 5ms, not a whole number; the nearest is 5ms"),
    ("10s", "10s\nwindow: 0", ":4: window: must be at least 1, not 0"),
    ("10s", "10s\nwindow: true", ":4: window: must be an integer, not true"),
    (
        "10s",
        "10s\nwindow: 8\nbatch: 5",
        ":5: batch: must be at most half the window (8), that is 4, not 5",
    ),
    ("10s", "10s\nbus: tcp", ":4: bus: must be a map, not 'tcp'"),
    ("10s", "10s\nbus: {transport: udp}", ":4: bus.transport: must be tcp or unix, not 'udp'"),
    (
        "10s",
        "10s\nbus: {port: 7447}",
        ":4: bus.port: is only for transport tcp; Unix sockets have no port",
    ),
    (
        "10s",
        "10s\nbus: {transport: tcp, port: 65533}",
        ":4: bus.port: must be at most 65532, not 65533",
    ),
    (
        "10s",
        "10s\ncheckpoint: 3ms",
        ":4: checkpoint: 3ms is 0.6 steps of 5ms, not a whole number; the nearest is 5ms",
    ),
    (
        "10s",
        "10s\nbus: {transport: tcp, low_latency: true}",
        (
            ":4: bus.low_latency: is only for transport unix; TCP never uses the low-latency transport; "
            "remove it"
        ),
    ),
    (
        "every: 4",
        "on_late: fail",
        ":17: participants.mission.on_late: applies only with real_time true; here real_time is false",
    ),
    (
        "10s",
        "10s\nreal_time: true",
        (
            ":4: real_time: unknown key 'real_time'; 'real_time' belongs to a participant: "
            "participants.NAME.real_time"
        ),
    ),
    (
        "10s",
        "10s\nexternal: true",
        (
            ":4: external: unknown key 'external'; a participant that you start yourself has "
            "`start: external`"
        ),
    ),
    (
        "10s",
        "10s\ntransport: tcp",
        ":4: transport: unknown key 'transport'; 'transport' belongs to `bus`",
    ),
    (
        "every: 4",
        "external: true",
        (
            ":17: participants.mission.external: unknown key 'external'; a participant that you "
            "start yourself has `start: external`"
        ),
    ),
    (
        "every: 4",
        "window: 3",
        (
            ":17: participants.mission.window: unknown key 'window'; 'window' belongs to the "
            "scenario: write it at the top level, next to `participants`"
        ),
    ),
    (
        "every: 4",
        "delay: 3",
        ":17: participants.mission.delay: unknown key 'delay'; 'delay' belongs to `inputs`",
    ),
    (
        "every: 4",
        "hold: 3s",
        ":17: participants.mission.hold: unknown key 'hold'; 'hold' belongs to `on_fault`",
    ),
    (
        "every: 4",
        "every: 4ms",
        (
            ":17: participants.mission.every: must be an integer, not '4ms'; it is a count, "
            "without a unit"
        ),
    ),
    (
        "every: 4",
        "every: '4'",
        ":17: participants.mission.every: must be an integer, not '4'; remove the quotes: 4",
    ),
    ("10s", "10s\nbus: {low_latency: 1}", ":4: bus.low_latency: must be true or false, not 1"),
    ("10s", "10s\nstep: 1s", ":4: step: is a duplicate key, first in line 2"),
    ("10s", "10s\n<<: {seed: 3}", ":4: '<<' is not YAML 1.2; write the keys out, or use extends"),
    (
        "kp: 100",
        "5: 1",
        ":14: participants.controller.params: a key must be text, not 5; put it in quotes",
    ),
    (
        "kp: 100",
        "kp: !gain 5",
        ":14: participants.controller.params.kp: the tag !gain is not supported",
    ),
    (
        "kp: 100",
        "kp: 99999999999999999999",
        (
            ":14: participants.controller.params.kp: the integer 99999999999999999999 does "
            "not fit into 64 bits"
        ),
    ),
    (
        "kp: 100",
        "kp: &x [*x]",
        ":14: participants.controller.params.kp[0]: an alias must not contain itself",
    ),
    (
        "kp: 100",
        'kp: "\\ud800"',
        ":14: participants.controller.params.kp: the text '\\ud800' is not valid Unicode",
    ),
    ("every: 4", "every: 0.5", ":17: participants.mission.every: must be an integer, not 0.5"),
    (
        "every: 4",
        "every: 99999999999999",
        (":17: participants.mission.every: must be at most 1844674407370, not 99999999999999"),
    ),
    (
        "every: 4",
        "step_timeout: 0s",
        ":17: participants.mission.step_timeout: '0s' must be longer than 0",
    ),
    ("every: 4", "params: [1]", ":17: participants.mission.params: must be a map, not a list"),
    (
        "delay: 1",
        "delay: -1",
        ":18: participants.mission.inputs.joint_state.delay: must be at least 0, not -1",
    ),
    (
        "delay: 1",
        "dely: 1",
        (
            ":18: participants.mission.inputs.joint_state.dely: unknown key 'dely'; did you "
            "mean 'delay'?"
        ),
    ),
    (
        "from: plant.joint_state, ",
        "",
        ":18: participants.mission.inputs.joint_state: the key 'from' is missing",
    ),
    (
        "{from: plant.joint_state, delay: 1}",
        "plant",
        (
            ":18: participants.mission.inputs.joint_state: must be PARTICIPANT.OUTPUT, e.g. "
            "plant.joint_state, not 'plant'"
        ),
    ),
    (
        "from: plant.joint_state",
        "from: plant.join_state",
        (
            ":18: participants.mission.inputs.joint_state: 'plant' has no output "
            "'join_state'; did you mean 'joint_state'?"
        ),
    ),
    (
        "from: plant.joint_state",
        "from: mission.reference",
        (
            ":18: participants.mission.inputs.joint_state: 'mission' reads its own output; "
            "keep that value as a variable of the participant instead"
        ),
    ),
    (
        "delay: 1",
        "delay: 1, type: Event/1",
        (
            ":18: participants.mission.inputs.joint_state: expects Event/1, but "
            "plant.joint_state is JointState/1 (participants.plant.outputs.joint_state)"
        ),
    ),
    (
        "JointReference/1",
        "{bulk: true}",
        ":19: participants.mission.outputs.reference: the key 'type' is missing",
    ),
    (
        "outputs: {joint_state",
        "outputs: {j.s: Event/1, joint_state",
        (
            ":9: participants.plant.outputs.j.s: 'j.s' is not a valid name; use 1 to 64 letters, "
            "digits, '_' and '-', starting with a letter or digit"
        ),
    ),
    (
        "  mission:",
        "  window: {exec: [python, -c, pass]}\n  mission:",
        (":15: participants.window: 'window' is a reserved name; choose another"),
    ),
    (
        "  mission:",
        "  other:\n  mission:",
        ":15: participants.other: needs either 'participant', a class, or 'exec', the command of a program",
    ),
]


@pytest.mark.parametrize(("old", "new", "message"), MISTAKES)
def test_a_mistake_has_its_sentence(tmp_path, old, new, message):
    assert problem_of(tmp_path, changed(old, new)) == f"scenario.yaml{message}"


def test_a_scenario_needs_a_participant(tmp_path):
    assert problem_of(tmp_path, "name: a\nstep: 5ms\nparticipants: {}\n") == (
        "scenario.yaml:3: participants: is empty; a scenario needs at least one participant"
    )


def test_both_sides_may_name_the_type(tmp_path):
    scenario = load_text(tmp_path, changed("delay: 1", "delay: 1, type: JointState/1"))
    assert scenario.participant("mission").inputs["joint_state"].type == "JointState/1"
