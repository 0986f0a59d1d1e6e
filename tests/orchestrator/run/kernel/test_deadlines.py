"""Who is late, by clocks that the test sets (P12)."""

import pytest
from support.runs.kernel import participant, scenario, states

from stepbus_orchestrator.errors import ParticipantDied, StartFailed, StepTimeout
from stepbus_orchestrator.run.kernel.deadlines import (
    LAST_WORDS_S,
    check_bulk,
    check_closing,
    check_start,
    check_step,
)
from stepbus_orchestrator.run.kernel.participants import Phase
from stepbus_orchestrator.run.kernel.state import RunState, at
from stepbus_schemas import Waiting


def started(*reports, closing=(), **options):
    """Return the state of a run of plant, mission and controller after some reports."""
    of = scenario(**options)
    state = RunState(of, participants=states(of), closing=closing)
    for name, step in reports:
        state.barrier.report(name, step)
    return state


@pytest.mark.parametrize(
    ("phase", "seconds", "sentence"),
    [
        (Phase.SPAWNED, 20, r"has not reached the bus.* 20 s \(participants\.plant\.spawn_timeout"),
        (Phase.ALIVE, 10, r"not asked to join.* 10 s \(participants\.plant\.join_timeout"),
        (Phase.JOINED, 30, r"is not ready.* 30 s \(participants\.plant\.ready_timeout"),
    ],
)
def test_each_phase_of_the_start_up_has_its_deadline(phase, seconds, sentence):
    state = RunState(scenario(participant("plant")))
    state.participants = states(state.scenario)
    state.participants["plant"].phase = phase
    check_start(state, seconds)
    with pytest.raises(StartFailed, match=sentence):
        check_start(state, 0.1)


def test_whoever_waits_for_a_source_that_loads_is_not_late():
    state = started()
    participants = state.participants
    participants["plant"].phase = Phase.SPAWNED
    participants["controller"].phase = Phase.JOINED
    participants["controller"].waiting = Waiting(step=-1, sources=["plant"])
    check_start(state, 19.0)
    assert (participants["controller"].in_phase_s, participants["plant"].in_phase_s) == (0.0, 19.0)


def test_one_that_a_stopped_reader_blocks_is_not_to_blame_for_the_start():
    state = started()
    participants = state.participants
    for one in participants.values():
        one.phase = Phase.READY
    # It hears of no mission while it publishes to the plant, which is stopped.
    participants["controller"].phase = Phase.JOINED
    participants["controller"].waiting = Waiting(step=-1, sources=["mission"])
    participants["plant"].process.stopped = True
    with pytest.raises(StartFailed, match="is ready, but does not answer") as failed:
        check_start(state, 31.0)
    assert failed.value.participant == "plant"


def test_a_participant_that_is_up_and_not_connected_is_late():
    state = started()
    participants = state.participants
    participants["controller"].phase = Phase.JOINED
    participants["controller"].waiting = Waiting(step=-1, sources=["plant"])
    with pytest.raises(StartFailed, match="is not connected to plant"):
        check_start(state, 31.0)


def test_the_one_that_holds_the_step_is_late_and_those_that_wait_are_not():
    state = started(("plant", 0), ("mission", 0))
    check_step(state, 2.9)
    with pytest.raises(StepTimeout, match=r"step 0 .*controller .*computing for 3\.1 s") as caught:
        check_step(state, 0.2)
    assert (caught.value.participant, caught.value.step) == ("controller", 0)


def test_the_clock_starts_anew_with_each_step():
    state = started(("plant", 0), ("mission", 0))
    check_step(state, 2.9)
    state.barrier.report("controller", 0)
    state.barrier.report("plant", 1)
    check_step(state, 2.9)
    assert state.participants["controller"].holds_s == 2.9


def test_a_stopped_process_is_blamed_before_those_it_blocks():
    state = started()
    state.participants["mission"].process.stopped = True
    with pytest.raises(StepTimeout, match=r"mission .* has been stopped by a signal") as caught:
        check_step(state, 3.1)
    assert "plant" not in str(caught.value)


def test_a_stopped_reader_is_blamed_for_the_step_that_it_blocks():
    # The controller has done its part, and reads nothing any more: the plant cannot publish.
    state = started(("controller", 0), ("mission", 0))
    state.participants["controller"].process.stopped = True
    with pytest.raises(StepTimeout, match=r"step 0 .*controller .* stopped .*3\.1 s") as caught:
        check_step(state, 3.1)
    assert caught.value.participant == "controller"


def test_one_that_is_stopped_before_it_is_ready_is_blamed_though_its_reader_is_stopped_too():
    state = started()
    plant, controller = state.participants["plant"], state.participants["controller"]
    plant.phase = Phase.JOINED
    plant.process.stopped = controller.process.stopped = True
    with pytest.raises(StartFailed) as failed:
        check_start(state, 31.0)
    assert failed.value.participant == "plant"


def test_a_message_that_was_lost_is_suspected_where_its_source_has_published():
    state = started(("plant", 0), ("mission", 0))
    state.participants["controller"].waiting = Waiting(step=0, sources=["plant"])
    with pytest.raises(StepTimeout, match=r"waiting for plant .* was a message lost or dropped"):
        check_step(state, 3.1)


def test_the_owed_step_is_what_others_wait_for_where_the_log_lags_behind():
    state = started(("plant", 0), ("plant", 1))
    state.participants["controller"].waiting = Waiting(step=5, sources=["plant"])
    assert state.owed_step(state.participants["plant"]) == 5
    state.participants["controller"].waiting = Waiting(step=7, sources=["mission"])
    assert state.owed_step(state.participants["mission"]) == 4


def test_closing_outputs_have_the_stop_deadline():
    state = started(steps=0, closing=["plant"])
    check_closing(state, 3.0)
    with pytest.raises(StepTimeout, match=r"plant .* has not published its closing outputs"):
        check_closing(state, 0.1)


@pytest.mark.parametrize(
    ("code", "took_nothing", "elapsed_s", "failure", "sentence"),
    [
        (3, False, LAST_WORDS_S, ParticipantDied, "exited with code 3"),
        (0, False, 3.1, ParticipantDied, "exited with code 0"),
        (-9, True, LAST_WORDS_S, StepTimeout, "has read no messages for 3 s while they queued up"),
    ],
)
def test_an_end_before_closing_outputs_is_named(code, took_nothing, elapsed_s, failure, sentence):
    state = started(steps=0, closing=["plant"])
    plant = state.participants["plant"]
    plant.process.code, plant.took_nothing = code, took_nothing
    with pytest.raises(failure, match=rf"step 0 .*: plant \(pid 7\) {sentence}"):
        check_closing(state, elapsed_s)


def test_the_last_outputs_of_one_that_has_ended_may_still_be_on_their_way():
    state = started(steps=0, closing=["plant"])
    state.participants["plant"].process.code = 0
    for _ in range(11):
        check_closing(state, 0.25)
    assert state.barrier.report("plant", 0)
    check_closing(state, 0.25)


def test_announced_bulk_content_has_the_stop_deadline_of_its_publisher():
    check_bulk(started(), {"plant": 2}, 2.9)
    check_bulk(started(), {}, 3.1)
    with pytest.raises(StepTimeout, match=r"step 2 .*plant .* announced bulk content") as error:
        check_bulk(started(), {"plant": 2}, 3.1)
    assert error.value.participant == "plant"


def test_a_step_is_named_with_its_time():
    assert at(412, 5_000_000) == "step 412 (t = 2.060 s)"
    assert at(-1, 5_000_000) == "before the first step"
