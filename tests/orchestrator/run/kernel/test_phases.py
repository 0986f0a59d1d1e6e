"""A run, phase by phase, as text: who is recorded when, and what follows what."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import pytest
from msgspec import structs
from support.runs.kernel import MISSION, PLANT, RunInMemory, participant, scenario
from support.surroundings import comes_true

from stepbus_orchestrator.errors import Interrupted, ParticipantDied, StepTimeout, StopTimeout
from stepbus_orchestrator.run.extensions.pace import Pace
from stepbus_orchestrator.run.extensions.safe_stop import SafeStop
from stepbus_orchestrator.scenario.model import HoldSpec

TWO_STEPS = "plant@0 mission@0 controller@0 plant@1 controller@1 plant@2"
HELD = participant("controller", "plant", "mission", on_fault=HoldSpec(keep_ns=0, hold_ns=10**7))


def test_a_run_starts_steps_closes_and_shuts_down():
    run = RunInMemory(scenario(steps=2))
    assert run.run() == "finished"
    assert " → ".join(run.phases) == "start-up → stepping → closing → shutdown"
    assert run.sink.text == TWO_STEPS
    assert (run.sink.ends, run.loop.is_recorded) == (["finish"], True)


@pytest.mark.parametrize("window", [1, 2, 64])
@pytest.mark.parametrize("order", [["plant", "mission", "controller"], ["controller", "mission", "plant"]])  # fmt: skip
def test_neither_window_nor_order_of_arrival_changes_what_is_recorded(window, order):
    run = RunInMemory(scenario(steps=2, window=window), order=order)
    run.run()
    assert run.sink.text == TWO_STEPS


def test_a_window_of_three_is_three_steps_ahead_of_the_barrier():
    run = RunInMemory(scenario(steps=8, window=3))
    run.run()
    assert run.bus.triggers[0] == 3
    assert all(later - earlier <= 3 for earlier, later in pairwise(run.bus.triggers))


def test_a_stop_that_is_lost_comes_again():
    run = RunInMemory(scenario(steps=2))
    run.bus.lost_stops = 2
    assert run.run() == "finished"
    assert (run.bus.stops, run.sink.text) == ([2], TWO_STEPS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("deaf", "failure", "sentence"),
    [
        ("plant", StepTimeout, r"step 2 .*: plant \(pid 7\) has read no messages for 0\.2 s"),
        ("mission", StopTimeout, r"mission \(pid 7\) read no messages for 0\.2 s .* killed"),
    ],
)
def test_one_that_takes_no_stop_is_killed_and_named(deaf, failure, sentence):
    members = (structs.replace(one, step_timeout_ns=2 * 10**8) for one in scenario().participants)
    run = RunInMemory(scenario(*members, steps=2))
    run.bus.deaf, run.bus.processes[deaf].stopped = deaf, deaf == "mission"
    with pytest.raises(failure, match=sentence) as caught:
        run.run()
    assert caught.value.participant == deaf
    assert [name for name, one in run.bus.processes.items() if one.signals] == [deaf]


def test_a_run_of_no_steps_records_closing_outputs_only():
    run = RunInMemory(scenario(steps=0))
    assert run.run() == "finished"
    assert run.sink.text == "plant@0"


def test_a_failure_goes_straight_to_shutdown_and_stops_everybody_at_once():
    run = RunInMemory(scenario(window=1), dies=("controller", 3))
    with pytest.raises(ParticipantDied, match=r"step 3 .*controller \(pid 7\) exited with code 3"):
        run.run()
    assert " → ".join(run.phases) == "start-up → stepping → shutdown"
    assert run.bus.stops == [-1]
    assert (run.sink.ends, run.loop.is_recorded) == ([], False)


@pytest.mark.slow
def test_a_participant_with_a_fallback_is_replaced_until_the_safe_stop():
    held = scenario(PLANT, MISSION, HELD, window=1, steps=100)
    run = RunInMemory(held, dies=("controller", 3), extensions=[SafeStop()])
    with pytest.raises(ParticipantDied, match="held from step 3 to 5"):
        run.run()
    assert " → ".join(run.phases) == "start-up → stepping → fallback → closing → shutdown"
    assert run.sink.ends == ["on_fault", "finish"]
    assert run.sink.text.endswith("plant@4 mission@4 controller@4 plant@5")


def test_an_interrupt_ends_the_run_at_its_next_turn():
    interrupt = threading.Event()
    interrupt.set()
    run = RunInMemory(scenario(), interrupt=interrupt)
    with pytest.raises(Interrupted):
        run.run()
    assert run.phases[-1] == "shutdown"


def test_a_paused_run_releases_no_step_beyond_the_pause_and_makes_nobody_late():
    pace, hurried = Pace(3), structs.replace(MISSION, step_timeout_ns=10**8)
    run = RunInMemory(scenario(hurried, steps=8, window=4), extensions=[pace])

    def resume():
        assert comes_true(lambda: "mission@0" in run.sink.text)
        time.sleep(0.5)
        pace.resume()

    with ThreadPoolExecutor() as pool:
        resumed = pool.submit(resume)
        run.run()
        resumed.result()
    assert run.bus.triggers == [3, 8]
