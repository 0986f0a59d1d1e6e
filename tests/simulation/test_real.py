"""What the simulator says of a tape is what real processes do under the same fault."""

import os
from random import Random

import pytest
from stepbus_simulation.campaign import commands, execute
from stepbus_simulation.draw import Draw
from stepbus_simulation.kinds import KINDS
from stepbus_simulation.programs import SCENARIOS, as_data
from stepbus_simulation.tape import Knobs, Tape
from support.paths import CHECKOUT

import stepbus

KNOBS = Knobs(step_ms=30_000, compute_us=1_000)
REAL = ("kill", "freeze", "never", "twice", "garbage")


def drawn(number):
    """Return a tape with one fault that real processes can be struck with."""
    random = Random(number)
    name = random.choice(["loop", "seen"])
    draw = Draw(random=random, names=list(SCENARIOS[name]()), steps=40)
    return Tape(name, 50, KNOBS, (KINDS[REAL[number % len(REAL)]].draw(draw),))


@pytest.mark.slow
@pytest.mark.parametrize("number", range(20))
def test_real_processes_agree(number, tmp_path, monkeypatch):
    tape = drawn(number)
    execution, problems = execute(tape)
    assert problems == []
    texts = [text.split("'")[1] for text in commands(execution)]
    if not texts or execution.result.at_step < 1:
        pytest.skip("it strikes nothing, or before the first step")
    monkeypatch.setenv("PYTHONPATH", os.fspath(CHECKOUT / "simulation"))
    data = as_data(tape.scenario, tape.steps, tape.knobs)
    result = stepbus.run(data, out=tmp_path / "run", faults=texts)
    simulated = execution.result
    assert (result.exit_code, result.participant) == (simulated.exit_code, simulated.participant)
    if result.exit_code == 0:
        assert result.messages_sha256 == simulated.messages_sha256
