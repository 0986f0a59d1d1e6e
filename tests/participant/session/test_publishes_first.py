"""What a participant with `publishes: first` may return, and how it ends a run."""

import pytest
from support.messages.scripted_bus import command, run_plant, stop

from stepbus_participant import Participant
from stepbus_schemas import JointCommand, JointState, RunError


class Plant(Participant):
    def output(self, step):
        return {"joint_state": JointState(position=[step.t])}


class ReturnsFromUpdate(Plant):
    def update(self, step):
        return {"joint_state": JointState(position=[step.t])}


class EndsInUpdate(Plant):
    def update(self, step):
        step.read("command", JointCommand)
        if step.index == 1:
            step.end("hit the floor")


class EndsInOutput(Plant):
    def output(self, step):
        if step.index == 1:
            step.end("hit the floor")
        return super().output(step)


class NeverPublishes(Participant):
    def publish(self, step):
        return {"joint_state": JointState(position=[step.t])}


def test_one_without_output_is_refused_before_the_first_step():
    with pytest.raises(RunError, match="NeverPublishes needs a method `output`"):
        run_plant(NeverPublishes, command(0), stop(1))


def test_messages_that_update_returns_are_refused():
    with pytest.raises(RunError, match="but with `publishes"):
        run_plant(ReturnsFromUpdate, command(0), stop(1))


def test_an_end_in_update_goes_out_with_the_next_outputs():
    outputs = run_plant(EndsInUpdate, command(0), command(1), command(2), stop(3))
    assert [o.get("end") for o in outputs] == [None, None, "hit the floor", None]


def test_an_end_in_output_goes_out_with_these_outputs():
    outputs = run_plant(EndsInOutput, command(0), command(1), stop(2))
    assert [o.get("end") for o in outputs] == [None, "hit the floor", None]


def test_output_that_is_never_called_is_refused():
    with pytest.raises(
        RunError, match="step 0: update returned nothing, and `output` is called only"
    ):
        run_plant(EndsInUpdate, command(0), stop(1), publishes="last")


def test_one_that_can_publish_in_both_ways_is_left_alone():
    outputs = run_plant(ReturnsFromUpdate, command(0), stop(1), publishes="last")
    assert outputs[0]["step"] == 0
