"""An input is read as a class that requires fields which are optional in its type."""

import re
from typing import ClassVar

import pytest
from support.runs.joints import run_joints

from stepbus import JointCommand, JointState, Message, Participant, SensedJoints, WiringError
from stepbus.errors import InvalidInput
from stepbus.testing import Bench, make_config
from stepbus_orchestrator.errors import ExitCode
from stepbus_schemas import Types, encode, type_name

FULL = JointState(position=[1.0], velocity=[2.0])


class Reader(Participant):
    inputs: ClassVar = {"joint_state": SensedJoints}

    def update(self, step):
        self.read = step.get("joint_state", SensedJoints)
        self.same = step.read("joint_state", JointState)


class Strange(Message, frozen=True):
    TYPE = "JointState/1"


def bench(cls=Reader):
    return Bench(cls, make_config(inputs={"joint_state": JointState}))


def test_it_is_the_same_type_on_the_wire():
    assert type_name(SensedJoints) == "JointState/1"
    assert Types.of([SensedJoints]).declarations == {}
    assert encode(SensedJoints(position=[1.0], velocity=[2.0])) == encode(FULL)


def test_a_whole_message_is_read_as_it_in_every_step():
    reader = bench()
    for _ in range(3):
        reader.step(joint_state=FULL)
        assert reader.participant.read == SensedJoints(position=[1.0], velocity=[2.0])
        assert reader.participant.same is reader.participant.read


def test_a_message_that_lacks_a_field_names_it_and_the_class():
    sentence = r"input 'joint_state': not a JointState/1 as SensedJoints requires it: Object missing required field `velocity`"
    with pytest.raises(InvalidInput, match=sentence):
        bench().step(joint_state=JointState(position=[1.0]))


@pytest.mark.parametrize("cls", [JointCommand, Strange])
def test_another_class_is_refused(cls):
    class Wrong(Participant):
        def update(self, step):
            step.get("joint_state", cls)

    with pytest.raises(WiringError, match=r"is read as .*, but the scenario connects JointState/1"):
        bench(Wrong).step(joint_state=FULL)


@pytest.mark.usefixtures("nothing_is_left")
def test_the_source_is_to_blame_in_a_run(tmp_path):
    lines = ["import stepbus", "class Needs(stepbus.Participant):", "    def update(self, step):",
             "        state = step.get('joint_state', stepbus.SensedJoints)",
             "        return {'command': stepbus.JointCommand(mode='torque', values=state.position)}",
             "stepbus.main(Needs)"]  # fmt: skip
    (tmp_path / "source").mkdir()
    (tmp_path / "source/needs.py").write_text("\n".join(lines))
    result = run_joints(tmp_path, "controller.exec=[python, needs.py]")
    assert (result.exit_code, result.participant) == (ExitCode.FAULT, "plant")
    assert re.search(r"plant\.joint_state \(input joint_state\): .* SensedJoints", result.reason)
