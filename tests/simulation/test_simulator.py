"""The simulator itself: it repeats, lets nothing escape, and finds what is broken."""

import json
import random
import re
import threading
import time
from random import Random

import pytest
from stepbus_simulation.campaign import draw_fault, draw_tape, execute, run_number
from stepbus_simulation.costs import costs
from stepbus_simulation.draw import Draw
from stepbus_simulation.escapes import Escape, no_escapes
from stepbus_simulation.kinds import KINDS
from stepbus_simulation.programs import SCENARIOS
from stepbus_simulation.shrink import shrink
from stepbus_simulation.tape import Fault, Knobs, Tape, load_tape
from support.paths import CHECKOUT

from stepbus_orchestrator.processes.watchdog import Watchdog
from stepbus_orchestrator.recording import McapFile

TAPES = sorted((CHECKOUT / "tests/simulation/tapes").glob("*.json"))


@pytest.mark.parametrize("path", TAPES, ids=lambda path: path.stem)
def test_what_a_tape_once_showed_holds(path):
    assert execute(load_tape(path))[1] == []


@pytest.mark.parametrize("number", range(6))
def test_the_same_tape_twice_is_the_same_run(number):
    tape = draw_tape(5, number)
    one, other = (execute(tape, keeps_trace=True)[0] for _ in range(2))
    assert one.world.trace == other.world.trace
    assert one.world.now_ns == other.world.now_ns


def test_undisturbed_runs_cost_what_they_did():
    """`python -m stepbus_simulation.costs` prints what they cost; keep it where that is meant."""
    assert costs() == json.loads((CHECKOUT / "tests/simulation/costs.json").read_text())


@pytest.mark.slow
def test_what_is_drawn_holds():
    assert {run_number(2, number).problem for number in range(40)} == {""}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_fault_takes_effect(kind):
    random = Random(kind)
    for name in ("called", "seen", "held") * 10:
        draw = Draw(random=random, names=list(SCENARIOS[name]), steps=50)
        execution, problems = execute(Tape(name, 50, Knobs(window=2), (draw_fault(kind, draw),)))
        assert problems == []
        if execution.effective:
            return
    raise AssertionError(f"{kind} does nothing")


@pytest.mark.parametrize(
    ("owner", "name", "arguments"),
    [
        (time, "monotonic", ()),
        (time, "sleep", (0.0,)),
        (random, "random", ()),
        (threading.Thread, "start", (None,)),
    ],
)
def test_simulated_code_cannot_escape(owner, name, arguments):
    with no_escapes(), pytest.raises(Escape, match=f"{name} was called"):
        getattr(owner, name)(*arguments)


def test_a_tape_is_kept_as_text(tmp_path):
    tape = draw_tape(3, 1)
    tape.save(tmp_path / "a.json")
    assert load_tape(tmp_path / "a.json") == tape


def test_a_failing_tape_is_shrunk_to_what_matters():
    cut = Fault("raise", "plant", 31)
    faults = (Fault("wall", "", 5, 7), cut, Fault("sleep", "", 8, 9))
    tape = Tape("held", 120, Knobs(window=2, link_us=1), faults)
    small = shrink(tape, lambda tape: any(fault.kind == "raise" for fault in tape.faults))
    assert small == Tape("loop", 10, Knobs(), (Fault("raise", "plant", 0),))


@pytest.mark.parametrize(
    ("kind", "target", "sentence"),
    [
        ("compute", "plant", "plant .* has been computing for"),
        ("compute", "controller", "controller .* has been computing for"),
        (
            "no_triggers",
            "orchestrator>controller",
            "controller .* waiting for the trigger .*, which was sent",
        ),
    ],
)
def test_a_report_of_a_wait_that_crosses_its_end_explains_nothing(kind, target, sentence):
    fault, knobs = Fault(kind, target, 7, 20_000_000_000), Knobs(window=1, link_us=15_000)
    assert re.search(sentence, execute(Tape(knobs=knobs, faults=(fault,)))[0].result.reason)


# --- mends taken out ------------------------------------------------------------------------


def test_without_a_watchdog_a_stopped_reader_blocks_the_run(monkeypatch):
    knobs = Knobs(buffer_bytes=5_000, compute_us=1_000)
    tape = Tape("seen", 120, knobs, (Fault("freeze", "camera", 10),))
    assert execute(tape)[1] == []
    monkeypatch.setattr(Watchdog, "_check", lambda _self: None)
    assert any("not ended in time" in problem for problem in execute(tape)[1])


def test_without_its_check_a_removed_folder_ends_well(monkeypatch):
    tape = Tape(faults=(Fault("folder", "", 60_000_000),))
    assert execute(tape)[1] == []
    monkeypatch.setattr(McapFile, "check", lambda _self: None)
    assert execute(tape)[1] != []
