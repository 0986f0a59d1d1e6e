"""What the orchestrator takes from participants, and what ends the run (P8.6)."""

import msgspec
import pytest
from support.runs.kernel import (
    TOKEN,
    Timing,
    Transcript,
    log,
    outputs,
    participant,
    scenario,
    states,
)

from stepbus_orchestrator.errors import ParticipantFault, StartFailed
from stepbus_orchestrator.run.kernel.messages import MessageHandler
from stepbus_orchestrator.run.kernel.participants import Phase
from stepbus_orchestrator.run.kernel.state import RunState
from stepbus_schemas import Fault, Hello, Log, Outputs, Ready, Refusal, Waiting, Welcome, encode


class Run:
    """A run that has started, and the handler of its messages."""

    def __init__(self, *participants):
        of = scenario(*participants)
        self.state = RunState(of, participants=states(of), started_at=1.0)
        self.handler = MessageHandler(self.state, TOKEN, Transcript(of), Timing())


@pytest.fixture
def run():
    return Run()


def test_a_log_moves_the_barrier(run):
    run.handler.take_log("plant", log("plant", 0, 1, 2))
    assert run.state.barrier.reported == {"plant": 2, "mission": -4, "controller": -1}


def test_a_log_tells_what_its_participant_waits_for(run):
    waiting = Waiting(step=3, sources=["plant"])
    run.handler.take_log("controller", log("controller", waiting=waiting))
    assert run.state.participants["controller"].waiting == waiting


@pytest.mark.parametrize(
    ("key_name", "data"),
    [
        ("plant", b"\xc1"),
        ("mission", log("plant", 0)),
        ("nobody", log("nobody", 0)),
        ("plant", log("plant", 0).replace(TOKEN.encode(), b"0ddba11500000000")),
    ],
    ids=["malformed", "another key", "no participant", "another token"],
)
def test_an_unauthenticated_log_is_counted_and_changes_nothing(run, key_name, data):
    run.handler.take_log(key_name, data)
    assert run.state.unauthenticated == 1
    assert set(run.state.barrier.reported.values()) == {-1, -4}


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        (outputs(1), "step 0 .*plant .* reported step 1 instead"),
        (Outputs(token=TOKEN, step=0, t_ns=7), "wrong token or time"),
        (Outputs(token="0", step=0, t_ns=0), "wrong token or time"),
        (Outputs(token=TOKEN, step=0, t_ns=0, ports={"stat": 1}), "published on 'stat', not a port"),
        (Outputs(token=TOKEN, step=0, t_ns=0, bulk={"state": 4}), "published a plain port as bulk"),
    ],
    ids=["a step left out", "a wrong time", "a wrong token", "an unknown port", "no bulk port"],
)  # fmt: skip
def test_a_log_that_breaks_the_protocol_is_its_senders_fault(run, entry, sentence):
    with pytest.raises(ParticipantFault, match=sentence) as caught:
        run.handler.take_log("plant", log_of(entry))
    assert caught.value.participant == "plant"


def log_of(entry):
    return encode(Log(name="plant", token=TOKEN, outputs=[msgspec.Raw(encode(entry))]))


def test_outputs_before_the_start_are_a_fault(run):
    run.state.started_at = 0.0
    with pytest.raises(ParticipantFault, match="sent outputs before the run started"):
        run.handler.take_log("plant", log("plant", 0))


def test_whoever_waits_for_somebody_who_is_no_source_is_at_fault(run):
    waiting = Waiting(step=0, sources=["mission"])
    with pytest.raises(ParticipantFault, match="not one of its sources"):
        run.handler.take_log("plant", log("plant", waiting=waiting))


def test_of_two_requests_to_end_the_earlier_step_counts(run):
    run.state.ask_end(9, "plant: full")
    run.state.ask_end(4, "mission: done")
    run.state.ask_end(7, "controller: reached")
    assert (run.state.last_step, run.state.reason) == (4, "mission: done")


def test_a_participant_that_is_alive_joined_and_ready_advances():
    run = Run(participant("plant"))
    plant = run.state.participants["plant"]
    plant.phase, phases, replies = Phase.SPAWNED, [], []
    run.handler.take_alive("plant", True)
    phases.append(plant.phase.name)
    run.handler.take_join(encode(hello("plant")), replies.append)
    phases.append(plant.phase.name)
    run.handler.take_ready("plant", encode(Ready(name="plant", token=TOKEN)))
    phases.append(plant.phase.name)
    assert " ".join(phases) == "ALIVE JOINED READY"
    assert isinstance(replies[0], Welcome)


def hello(name, **fields):
    return Hello(**{"protocol": 2, "name": name, "token": TOKEN, "pid": 7, **fields})


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (hello("plant", token="0"), "the ticket is for another run"),
        (hello("plnt"), "no participant 'plnt' in this run; it"),
    ],
)
def test_an_unauthenticated_hello_is_refused_and_counted(message, reason):
    run, replies = Run(participant("plant")), []
    run.handler.take_join(encode(message), replies.append)
    assert isinstance(replies[0], Refusal)
    assert replies[0].reason.startswith(reason)
    assert run.state.unauthenticated == 1


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"protocol": 3}, 'plant speaks protocol 3, and this run'),
        ({"outputs": {"state": "JointState/9"}}, 'output plant.state: the program has'),
    ],
)  # fmt: skip
def test_a_participant_that_cannot_join_ends_the_run(fields, reason):
    run, replies = Run(participant("plant")), []
    with pytest.raises(StartFailed, match=f"plant .* was refused: {reason}"):
        run.handler.take_join(encode(hello("plant", **fields)), replies.append)
    assert isinstance(replies[0], Refusal)


@pytest.mark.parametrize(
    ("fields", "number"),
    [
        ({"protocol": 2}, 2),
        ({"protocol": 3, "lowest_protocol": 2}, 2),
        ({"protocol": 9, "lowest_protocol": 1}, 2),
    ],
)
def test_a_welcome_names_the_highest_common_protocol(fields, number):
    run, replies = Run(participant("plant")), []
    run.handler.take_join(encode(hello("plant", **fields)), replies.append)
    assert replies[0].protocol == number


def test_a_fault_ends_the_run_and_blames_whom_it_names(run):
    fault = Fault(
        name="plant", token=TOKEN, step=3, type="message", message="no", blames="controller"
    )
    with pytest.raises(ParticipantFault, match=r"step 3 .*controller .*no \(seen by plant") as caught:  # fmt: skip
        run.handler.take_fault("plant", encode(fault))
    assert (caught.value.participant, caught.value.witness) == ("controller", "plant")


def test_what_comes_late_from_a_participant_that_is_replaced_is_dropped(run):
    run.state.replaced = "plant"
    run.handler.take_log("plant", log("plant", 0))
    assert (run.state.barrier.reported["plant"], run.state.unauthenticated) == (-1, 0)


def test_a_process_that_leaves_the_bus_is_checked_at_once(run):
    run.handler.take_alive("plant", False)
    assert run.state.is_check_due
