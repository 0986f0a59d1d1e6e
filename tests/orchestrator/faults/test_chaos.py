"""`make chaos`: faults of every type, each survived or blamed."""

import random
import re

import pytest
from support.messages.recordings import messages
from support.runs.joints import leftovers

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.fault_texts import FAULT_TYPES
from stepbus_orchestrator.scenario.load import load

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

SEED = 20261121
EACH = 20
STEPS = 200
NAMES = ("plant", "controller", "mission")
LOST = {"drop", "corrupt", "oversize", "reorder"}
"""Types after which the orchestrator publishes the message again (P8.7)."""
AHEAD = "mission"
"""It waits for no other participant: its readers find a skipped step, unless it was the last."""
OVERRIDES = ["duration=1s", *(f"{name}.step_timeout=1500ms" for name in NAMES)]
PATIENT = [f"{name}.step_timeout=30s" for name in NAMES]


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Return the messages of a run without faults."""
    out = tmp_path_factory.mktemp("reference") / "out"
    result = run(load("two_link", OVERRIDES), Options(out=out))
    assert result.exit_code == 0, result.reason
    return messages(result.recording)


def draw(fault_type):
    """Return the faults of one type: (text, participant, step), the same in every session."""
    generator = random.Random(f"{SEED} {fault_type}")
    for _ in range(EACH):
        name, step = generator.choice(NAMES), generator.randrange(STEPS)
        lasts_ms = generator.randrange(10, 400)
        lasting = fault_type in {"delay", "slow"} or (
            fault_type == "freeze" and generator.random() < 0.5
        )
        lasts = f" for {lasts_ms}ms" if lasting else ""
        yield f"{fault_type} {name} at {step}{lasts}", name, step


def costs_time(fault_type, text):
    """Return whether a fault holds somebody up for a time, and no more."""
    return fault_type in {"delay", "duplicate", "slow"} or (
        fault_type == "freeze" and " for " in text
    )


def costs_only_time(fault_type, text):
    """Return whether a fault changes no message, so that the run survives it (docs/faults.md)."""
    return costs_time(fault_type, text) or (fault_type in LOST and f" {AHEAD} " not in text)


@pytest.mark.parametrize("fault_type", FAULT_TYPES)
def test_a_fault_that_costs_only_time_is_survived_and_any_other_is_blamed(
    tmp_path, own_temp, reference, fault_type
):
    for number, (text, name, step) in enumerate(draw(fault_type)):
        out = tmp_path / str(number)
        patient = PATIENT if costs_time(fault_type, text) else []
        result = run(load("two_link", [*OVERRIDES, *patient], [text]), Options(out=out))
        recorded = messages(result.recording)
        assert Recording(result.recording).damage == "", text
        was_last = fault_type in LOST and result.exit_code == 0
        if was_last or costs_only_time(fault_type, text):
            assert (result.exit_code, recorded == reference) == (0, True), (text, result.reason)
        else:
            assert result.exit_code != 0, text
            assert name in result.reason, (text, result.reason)
            assert re.search(rf"\bstep {step}\b", result.reason), (text, result.reason)
            assert len(recorded) >= 4 * step, text
        assert leftovers(own_temp) == [], text
        assert list(own_temp.iterdir()) == [], text
