"""A participant on the bench behaves as in a run."""

from types import MappingProxyType

import pytest

from stepbus import (
    Description,
    JointCommand,
    JointReference,
    JointState,
    Method,
    Participant,
    WiringError,
)
from stepbus.errors import InputAbsent, OutputError
from stepbus.testing import Bench, feed, make_config, scenario_config
from stepbus_controller.controller import Controller

PORTS = {"inputs": {"joint_state": JointState}, "outputs": {"command": JointCommand}}


class Spring(Participant):
    """Pushes every joint back to zero, and ends the run when it is there."""

    def describe(self):
        return {"command": Description(like="joint_state")}

    def start(self, inputs):
        self.names = inputs["joint_state"].names
        self.steps = []

    def calls(self):
        return {"names": Method(lambda: self.names, "the joints")}

    def update(self, step):
        state = step.read("joint_state", JointState)
        self.steps.append((step.index, step.is_new("joint_state")))
        if max(map(abs, state.position)) == 0.0:
            step.end("at rest")
        return {"command": JointCommand(values=[-q for q in state.position], mode="torque")}

    def close(self):
        self.steps = None


@pytest.fixture
def bench():
    return Bench(Spring, make_config(**PORTS), {"joint_state": Description(names=["hip"])})


def test_it_publishes_what_the_participant_returns_and_holds_inputs(bench):
    assert bench.step(joint_state=JointState(position=[0.5]))["command"].values == [-0.5]
    assert bench.step()["command"].values == [-0.5]
    assert bench.participant.steps == [(0, True), (1, False)]


def test_steps_count_on_by_every():
    bench = Bench(Spring, make_config(every=4, **PORTS))
    for _ in range(3):
        bench.step(joint_state=JointState(position=[0.5]))
    bench.step(40)
    assert [index for index, _ in bench.participant.steps] == [0, 4, 8, 40]


def test_an_input_is_absent_before_its_first_message(bench):
    with pytest.raises(InputAbsent, match="input 'joint_state' has no message yet"):
        bench.step()


def test_descriptions_go_both_ways_and_the_end_of_the_run_is_seen(bench):
    assert bench.descriptions["command"].like == "joint_state"
    assert bench.call("names") == ["hip"]
    bench.step(joint_state=JointState(position=[0.0]))
    assert bench.end_reason == "at rest"


def test_it_closes_what_it_opened():
    with Bench(Spring, make_config(**PORTS)) as bench:
        assert bench.participant.steps == []
    assert bench.participant.steps is None


def test_inputs_and_outputs_must_be_those_of_the_configuration(bench):
    with pytest.raises(WiringError, match="did you mean 'joint_state'"):
        bench.step(joint_states=JointState(position=[0.5]))
    with pytest.raises(WiringError, match="takes JointState/1, got JointComm"):
        bench.step(joint_state=JointCommand(values=[0.5], mode="torque"))
    wrong = Bench(Spring, make_config(inputs=PORTS["inputs"], outputs={"torque": JointCommand}))
    with pytest.raises(OutputError, match=r"step 0: .* no output port 'command'; it has torque"):
        wrong.step(joint_state=JointState(position=[0.5]))
    wrong = Bench(Spring, make_config(inputs=PORTS["inputs"], outputs={"command": JointState}))
    with pytest.raises(OutputError, match="takes JointState/1, got JointCommand"):
        wrong.step(joint_state=JointState(position=[0.5]))


class Mistyped(Spring):
    def update(self, step):
        return {"command": JointCommand(values="many", mode="torque")}


def test_a_message_that_no_reader_could_decode_is_refused():
    bench = Bench(Mistyped, make_config(**PORTS))
    with pytest.raises(OutputError, match=r"port 'command': not a .* values: Expected `array`"):
        bench.step(joint_state=JointState(position=[0.5]))


class Integrator(Participant):
    """A plant of one joint: publishes before it reads."""

    position = 0.0

    def output(self, step):
        return {"joint_state": JointState(position=[self.position])}

    def update(self, step):
        self.position += step.read("command").values[0]


def test_who_publishes_first_does_not_see_the_inputs_of_the_step():
    config = make_config(
        inputs={"command": "JointCommand/1"},
        outputs={"joint_state": "JointState/1"},
        publishes="first",
    )
    bench = Bench(Integrator, config)
    push = JointCommand(values=[1.0], mode="torque")
    sent = [bench.step(command=push)["joint_state"].position for _ in range(3)]
    assert sent == [[0.0], [1.0], [2.0]]


def test_a_shipped_controller_runs_on_the_bench_of_its_scenario():
    config = scenario_config("two_link", "controller", set={"controller.params.law": "pd"})
    joints = Description(names=["joint1", "joint2"])
    bench = Bench(Controller, config, {"joint_state": joints, "reference": joints})
    state = JointState(position=[0.1, 0.2], velocity=[0.0, 0.0])
    target = JointReference(position=[0.0, 0.0], velocity=[0.0, 0.0], acceleration=[0.0, 0.0])
    published = bench.step(joint_state=state, reference=target)
    assert len(published["command"].values) == 2


def test_a_step_can_be_fed_by_hand():
    step = feed(20, step="10ms", joint_state=JointState(position=[1.0]))
    assert (step.index, step.t, step.is_new("joint_state")) == (20, 0.2, True)
    assert step.read("joint_state", JointState).position == [1.0]
    assert Spring(make_config(**PORTS)).describe()["command"].like == "joint_state"


class Declares(Participant):
    inputs = MappingProxyType({"joint_state": JointState})
    outputs = MappingProxyType({"command": JointCommand})

    def update(self, step):
        return {"command": JointCommand(effort=step.get("joint_stat").position)}


def test_a_class_that_declares_its_ports_needs_no_configuration():
    bench = Bench(Declares)
    assert (list(bench.config.inputs), list(bench.config.outputs)) == (["joint_state"], ["command"])
