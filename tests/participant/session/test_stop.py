"""When a participant ends, whatever is still under way to it."""

import msgspec
import pytest
from support.messages.scripted_bus import TOKEN, command, run_plant, stop

from stepbus_participant import Participant
from stepbus_participant.session import session
from stepbus_participant.session.session import Terminated
from stepbus_schemas import JointCommand, JointState, RunError, Trigger


class Plant(Participant):
    def output(self, step):
        return {"joint_state": JointState(position=[step.t])}

    def update(self, step):
        step.read("command", JointCommand)


def published(*script):
    """Return the steps that a plant publishes."""
    return [outputs["step"] for outputs in run_plant(Plant, *script)]


@pytest.mark.parametrize(
    "script",
    [
        [command(0), command(1), stop(2)],
        [command(0), stop(2), command(1)],
        [stop(2), command(0), command(1)],
        [stop(2), stop(2), command(0), stop(2), command(1)],
    ],
)
def test_the_steps_before_the_stop_are_finished_in_whatever_order_messages_come(script):
    assert published(*script) == [0, 1, 2]


def test_a_stop_at_a_step_that_is_behind_ends_at_once():
    assert published(command(0), command(1), command(2), stop(2)) == [0, 1, 2]


def test_a_negative_step_ends_at_once():
    assert published(stop(-1)) == []


class Follower(Participant):
    def update(self, step):
        step.read("command", JointCommand)
        return {"joint_state": JointState(position=[step.t])}


def follow(*script, later):
    """Return the steps of one that may do a single step, and then waits for the next trigger."""
    outputs = run_plant(Follower, *script, publishes="last", step_limit=1, later=later)
    return [item["step"] for item in outputs]


def test_an_input_that_comes_before_its_trigger_is_kept():
    trigger = "trigger", Trigger(token=TOKEN, step_limit=3)
    later = [trigger, command(2), stop(3)]
    assert follow(command(0), command(1), later=later) == [0, 1, 2]


def test_an_input_of_a_step_that_is_never_released_is_not_read():
    broken = "out/controller", msgspec.msgpack.encode({"token": TOKEN, "step": "one"})
    assert follow(command(0), broken, later=[stop(1)]) == [0]


@pytest.mark.parametrize(("part", "name"), [(session.Control, "wait"), (session, "encode")])
def test_a_sigterm_does_not_hide_why_a_participant_failed(capsys, monkeypatch, part, name):
    """It comes before the stop, or while the participant reports."""

    class Failing(Plant):
        def update(self, step):
            monkeypatch.setattr(part, name, terminate)
            raise ValueError("the knee")

    waits = []

    def terminate(*arguments):
        waits.append(arguments)
        raise Terminated("ended by SIGTERM")

    with pytest.raises(RunError, match="step 0: the knee"):
        run_plant(Failing, command(0), later=[])
    assert len(waits) == 1
    assert capsys.readouterr().err.endswith("ValueError: the knee\n")
