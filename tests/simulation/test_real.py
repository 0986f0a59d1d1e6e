"""What the simulator says of a tape is what real processes do under the same `--fault`."""

import os
from random import Random

import pytest
from stepbus_simulation.campaign import draw_fault, execute
from stepbus_simulation.draw import Draw
from stepbus_simulation.kinds import INJECTED
from stepbus_simulation.programs import SCENARIOS, as_data
from stepbus_simulation.tape import Knobs, Tape
from support.paths import CHECKOUT

import stepbus
from stepbus_orchestrator.scenario.fault_texts import FAULT_TYPES

KNOBS = Knobs(step_ms=30_000, compute_us=1_000)
REAL = [*INJECTED] * 2


def test_the_simulator_has_every_fault_of_a_run():
    assert set(INJECTED) == set(FAULT_TYPES)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "kind"), list(enumerate(REAL)))
def test_real_processes_agree(number, kind, tmp_path, monkeypatch):
    random = Random(number)
    # What is published again may reach a camera after the next message (P8.7), which it reports.
    name = random.choice(["loop", "seen"]) if kind != "drop" else "loop"
    draw = Draw(random=random, names=list(SCENARIOS[name]), steps=40)
    tape = Tape(name, 50, KNOBS, (draw_fault(kind, draw),))
    execution, problems = execute(tape)
    assert problems == []
    monkeypatch.setenv("PYTHONPATH", os.fspath(CHECKOUT / "simulation"))
    data = as_data(tape.scenario, tape.steps, tape.knobs)
    result = stepbus.run(data, out=tmp_path / "run", faults=execution.as_options())
    simulated = execution.result
    assert (result.exit_code, result.participant) == (simulated.exit_code, simulated.participant)
    if result.exit_code == 0:
        assert result.messages_sha256 == simulated.messages_sha256
