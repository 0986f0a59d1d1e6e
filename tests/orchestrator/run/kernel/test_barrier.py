"""The step barrier: complete steps, the trigger (P5.5), who holds a step (P12.2); and gates (P5.2)."""

from support.runs.kernel import participant, scenario

from stepbus_orchestrator.run.kernel.barrier import FAR, Barrier, step_limit


def barrier(*reports, **options):
    """Return the barrier of plant, mission (every 4) and controller after some reports."""
    made = Barrier(scenario(**options))
    for name, step in reports:
        assert made.report(name, step)
    return made


def test_a_step_is_complete_when_every_output_due_in_it_is_reported():
    assert barrier(("plant", 0), ("mission", 0), ("controller", 0)).completed == 1
    # The mission fires every fourth step.
    reports = [("mission", 0), *((n, s) for s in range(4) for n in ("plant", "controller"))]
    assert barrier(*reports).completed == 4


def test_a_step_that_is_not_the_next_one_is_refused():
    made = Barrier(scenario())
    assert not made.report("plant", 1)
    assert not made.report("mission", 1)
    assert made.reported == {"plant": -1, "mission": -4, "controller": -1}


def test_the_trigger_is_a_window_ahead_of_the_barrier():
    assert barrier(window=3).step_limit == 3
    assert barrier(("plant", 0), ("mission", 0), ("controller", 0), window=3).step_limit == 4


def test_whoever_owes_an_output_and_has_its_inputs_holds_the_step():
    # The plant publishes first: it needs nothing for its first output.
    assert barrier().holders() == ["plant", "mission"]
    assert barrier(("plant", 0), ("mission", 0)).holders() == ["controller"]
    # The controller waits for the mission.
    assert barrier(("plant", 0)).holders() == ["mission"]
    assert barrier(("plant", 0)).missing("controller") == ["mission"]


def test_one_that_publishes_first_needs_the_inputs_of_the_step_before():
    reports = [("plant", 0), ("mission", 0)]
    assert barrier(*reports).missing("plant") == ["controller"]
    assert barrier(*reports, ("controller", 0)).holders() == ["plant"]


def test_a_delayed_input_needs_the_output_of_an_earlier_step():
    loop = (participant("a", "b", delay=1), participant("b", "a"))
    made = Barrier(scenario(*loop))
    assert made.holders() == ["a"]
    assert (made.report("a", 0), made.holders()) == (True, ["b"])
    assert made.missing("a") == ["b"]


def test_those_without_whose_outputs_no_further_step_is_complete():
    assert barrier().last() == ["plant", "mission", "controller"]
    made = barrier(("plant", 0), ("mission", 0))
    assert made.last() == ["controller"]
    assert (made.report("controller", 0), made.last()) == (True, ["plant", "controller"])


def before(step):
    """Return a gate before a step."""
    return lambda _released: step


def test_the_nearest_gate_decides():
    assert step_limit(Barrier(scenario(steps=100)), [before(9), before(FAR), before(4)], 0) == 4


def test_what_has_been_released_is_never_taken_back():
    assert step_limit(Barrier(scenario(steps=100)), [before(4)], 7) == 7
