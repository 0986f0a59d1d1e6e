"""The checks of the conformance kit: right programs pass, and each mistake is found."""

import re
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from support.paths import CHECKOUT
from support.runs.conformance import FOUND_BY, MAY_FAIL, failed, material, ours, outcomes, program
from support.runs.joints import leftovers

from stepbus_orchestrator.errors import Interrupted, ScenarioError
from stepbus_orchestrator.scenario.load import load
from stepbus_tools.conformance import conformance

EXAMPLES = sorted(path.parent for path in CHECKOUT.glob("examples/controllers/*/scenario.yaml"))

SHORT = (
    "controller.step_timeout=2s", "controller.stop_timeout=1s", "controller.join_timeout=2s",
)  # fmt: skip
"""For mistakes of which some deadline finds each."""
PATIENT = ("controller.step_timeout=30s", "controller.stop_timeout=30s")

# Mistake → the check whose sentence is tested; the others: the first one.
SAID_BY = {"AnyWelcome": "welcome-protocol", "StepsMissing": "steps"}

# Mistake → what the kit says of it, by that check.
SAID = {
    "AnyWelcome": "it became ready after a Welcome of protocol 1000|did not end within .* of a `Welcome`",
    "AsksOne": "reaches both processes on `join` .* did not arrive: it exited with code 1",
    "Clock": r"two runs with the same inputs differ: step \d+: command",
    "ExitsZeroWithoutTicket": "exited with code 0 without a ticket",
    "Consolidates": "its last output: another process refuses you again",
    "FirstReply": "Ready did not arrive: .*no MessagePack",
    "FixedOrder": r"with the joints of .* in reverse order, .*command.*is",
    "ForgivesDuplicates": "reported no fault of plant",
    "HangsAtGarbage": "step 0 did not arrive within 4 s",
    "IgnoresDelay": "it reports a fault only with joint_state absent at first",
    "IgnoresTriggers": r"published step 12 before a Trigger with step_limit > 12",
    "OnlyFloats": "it reported a fault",
    "RoundsToZero": "step 0 did not arrive within 4 s; it reports that it is waiting for",
    "StepsMissing": "step 5 did not arrive|step 6 was published instead of 5",
    "StopsAtOnce": r"the last step it published is 11, expected 12 \(P11.2\)",
    "StrangerOutputs": "has another token",
    "TicketNumber": "its Hello names protocol 1000; expected: protocol 2, or a range that includes it",
    "TwiceDifferent": "step 0 was published twice",
    "Unwatchful": "did not end within 4 s of the orchestrator's disappearance",
    "ZerosForHeld": "do not depend on the messages of step 12",
}


EXPIRES = {
    "AnyWelcome": "join", "AsksOne": "join", "HangsAtGarbage": "step", "RoundsToZero": "step",
    "StepsMissing": "step", "StrangerOutputs": "step", "TwiceDifferent": "step", "Unwatchful": "stop",
}  # fmt: skip
"""Which deadline finds a mistake; the others need none."""


@pytest.fixture(scope="module")
def inputs(two_link_recording):
    return material(two_link_recording, "controller", *PATIENT)


@pytest.fixture(scope="module")
def hurried_inputs(two_link_recording):
    return material(two_link_recording, "controller", *SHORT)


@pytest.mark.slow
def test_each_mistake_is_found_and_named(two_link_recording, inputs, tmp_path):
    def given(mistake):
        if mistake not in EXPIRES:
            return inputs
        deadlines = [*PATIENT, f"controller.{EXPIRES[mistake]}_timeout=4s"]
        return material(two_link_recording, "controller", *deadlines)

    def check(mistake):
        words = program("wrong_controller.py", mistake)
        name = SAID_BY.get(mistake, FOUND_BY[mistake][0])
        return outcomes(given(mistake), words, tmp_path / mistake, [name])[name]

    # Half of them only wait for a deadline.
    with ThreadPoolExecutor(3) as pool:
        found = dict(zip(SAID, pool.map(check, SAID), strict=True))
    assert {mistake: result.outcome for mistake, result in found.items()} == dict.fromkeys(
        SAID, "fail"
    )
    unnamed = {mistake: result.observed for mistake, result in found.items()
               if not re.search(SAID[mistake], result.observed)}  # fmt: skip
    assert unnamed == {}


def test_a_program_that_exits_with_three_fails_the_stop_and_nothing_before_it(inputs, tmp_path):
    names = ["steps", "log", "stop-at-end"]
    results = outcomes(inputs, program("wrong_controller.py", "ExitsThree"), tmp_path, names)
    assert failed(results) == ["stop-at-end"]
    assert "exited with code 3" in results["stop-at-end"].observed


def test_where_the_outputs_vary_what_compares_them_is_skipped(inputs, tmp_path):
    names = ["steps", "determinism", "triggers", "duplicate"]
    results = outcomes(inputs, program("wrong_controller.py", "Random"), tmp_path, names)
    assert [result.outcome for result in results.values()] == ["pass", "fail", "skipped", "skipped"]


def test_what_only_one_of_two_codecs_reads_fails_with_a_sentence(inputs, tmp_path):
    words = program("wrong_controller.py", "NoText")
    results = outcomes(inputs, words, tmp_path, ["content", "codecs"])
    assert failed(results) == ["codecs"]
    assert re.match(
        r"a message on log/controller: msgpack: not MessagePack: 'utf-8' codec can't decode",
        results["codecs"].observed,
    )


@pytest.mark.slow
def test_where_the_plain_run_fails_only_that_check_does(hurried_inputs, tmp_path):
    names = ["join", "steps", "log", "windows", "stop-at-end"]
    results = outcomes(
        hurried_inputs, program("wrong_controller.py", "StepsMissing"), tmp_path, names
    )
    assert failed(results) == ["steps"]
    assert "`steps` fails" in results["windows"].observed


def test_a_program_that_joins_no_run_is_killed_in_time(two_link_recording, tmp_path):
    quick = ("controller.spawn_timeout=300ms", "controller.join_timeout=300ms")
    inputs = material(two_link_recording, "controller", *quick)
    results = outcomes(inputs, ("/bin/sleep", "1000"), tmp_path, ["join"])
    assert "join did not arrive within 0.6 s" in results["join"].observed


def test_a_check_alone_fails_for_a_program_that_does_not_start(two_link_recording, tmp_path):
    inputs = material(two_link_recording, "controller")
    results = outcomes(inputs, ("/bin/false",), tmp_path, ["determinism"])
    assert results["determinism"].outcome == "fail"
    assert "needs a plain run" in results["determinism"].observed


@pytest.mark.slow
def test_nothing_is_left_of_a_program_that_hangs(hurried_inputs, tmp_path):
    words = program("wrong_controller.py", "HangsAtGarbage")
    outcomes(hurried_inputs, words, tmp_path, ["garbage"])
    assert leftovers(tmp_path) == []


def test_checks_of_inputs_are_skipped_for_a_participant_without_any(two_link_recording, tmp_path):
    inputs = material(two_link_recording, "mission")
    results = outcomes(inputs, ("/bin/false",), tmp_path, ["late-input", "joint-order"])
    assert [result.observed for result in results.values()] == ["it has no inputs"] * 2


def test_ctrl_c_ends_the_kit_in_the_middle_of_a_check(inputs, tmp_path):
    interrupt = threading.Event()
    interrupt.set()
    with pytest.raises(Interrupted):
        outcomes(inputs, ("/bin/sleep", "1000"), tmp_path, ["join"], interrupt=interrupt)
    assert leftovers(tmp_path) == []


# --- all checks -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_each_mistake_fails_exactly_the_checks_that_find_it(two_link_recording, tmp_path):
    deadlines = ("controller.step_timeout=10s", "controller.stop_timeout=10s")
    inputs = material(two_link_recording, "controller", *deadlines)

    def run(mistake):
        words = program("wrong_controller.py", mistake)
        results = outcomes(inputs, words, tmp_path / mistake)
        return {name: results[name].observed for name in failed(results)}

    with ThreadPoolExecutor(2) as pool:
        found = dict(zip(FOUND_BY, pool.map(run, FOUND_BY), strict=True))
    strange = {
        mistake: {n: text for n, text in told.items() if n not in FOUND_BY[mistake]}
        for mistake, told in found.items()
        if set(told) - set(MAY_FAIL.get(mistake, ())) - set(FOUND_BY[mistake])
    }
    assert strange == {}
    told = {mistake: [n for n in names if n not in MAY_FAIL.get(mistake, ())]
            for mistake, names in found.items()}  # fmt: skip
    assert told == FOUND_BY


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("participant", ["controller", "mission", "plant"])
def test_our_own_participants_pass_every_check(two_link_recording, tmp_path, participant):
    inputs = material(two_link_recording, participant)
    assert failed(outcomes(inputs, ours(participant), tmp_path)) == []


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_program_written_from_the_page_passes_every_check(inputs, tmp_path):
    results = outcomes(inputs, program("by_the_page.py"), tmp_path)
    skipped = [name for name, result in results.items() if result.outcome == "skipped"]
    # test_bulk.py plays bulk ports; the page leaves it to a program whether it takes batches.
    bulk = ["bulk-late", "bulk-noise", "slots", "slot-stamp", "bulk-length"]
    assert (failed(results), skipped) == ([], ["port-types", "batches", *bulk])


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("folder", EXAMPLES, ids=lambda folder: folder.name)
def test_the_controllers_in_other_languages_pass_every_check(folder):
    try:
        scenario = load(folder)
    except ScenarioError as exc:
        pytest.skip(str(exc))
    report = conformance(scenario, "controller")
    assert [check for check in report.checks if check.outcome == "fail"] == []
