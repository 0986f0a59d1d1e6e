"""The first part: runs that are struck from outside."""

from __future__ import annotations

import os
import random
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass

from .faults import FAULTS
from .faults.streams import open_stream
from .judge import ORPHAN_GRACE_S, Verdict, judge
from .log_reader import result
from .sandbox import Sandbox, sandbox
from .scenarios import SCENARIOS, Reference, reference

MARGIN_S = 2.0
"""How much later than its deadline a run may end [s]."""
HANG_S = 120.0
"""After so long, something hangs on the slowest machine [s]."""
_ATTEMPTS = 4


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run, and what strikes it when."""

    number: int
    fault: str
    scenario: str
    moment: str

    def __str__(self) -> str:
        """Return the case in words."""
        return f"#{self.number} {self.fault}, {self.scenario}, {self.moment}"


def cases(count: int, seed: int) -> list[Case]:
    """Return the cases, every type of fault in turn."""
    chance = random.Random(seed)
    names, rows = list(FAULTS), []
    weights = [scenario.weight for scenario in SCENARIOS.values()]
    for number in range(count):
        if number % len(names) == 0:
            # A sample shorter than the list takes other faults with another seed.
            chance.shuffle(names)
        name = names[number % len(names)]
        (scenario,) = chance.choices(list(SCENARIOS), weights)
        moment = chance.choice(FAULTS[name].when)
        rows.append(Case(number=number, fault=name, scenario=scenario, moment=moment))
    return rows


def strike(rows: list[Case], seed: int, patience: float) -> Iterator[tuple[Case, Verdict]]:
    """Run every case and yield what came of it.

    patience: factor of all deadlines; see `_limit_s`.
    """
    for case in rows:
        try:
            yield case, run_case(case, seed, patience)
        except Exception:  # noqa: BLE001  (one case must not end the campaign)
            yield case, Verdict(None, 0.0, [f"the campaign: {traceback.format_exc()}"])


def run_case(case: Case, seed: int, patience: float) -> Verdict:
    """Run one scenario, strike, and judge; again where the run ended before the fault."""
    undisturbed = None if FAULTS[case.fault].endless else reference(case.scenario, patience)
    if undisturbed is not None and undisturbed.wrong:
        said = f"the undisturbed run failed: {undisturbed.wrong}"
        return Verdict(None, undisturbed.seconds, [said])
    for attempt in range(_ATTEMPTS):
        verdict = _run_once(
            case, f"{seed} {attempt}" if attempt else str(seed), patience, undisturbed
        )
        if not verdict.missed:
            return verdict
    return verdict


def _run_once(case: Case, seed: str, patience: float, undisturbed: Reference | None) -> Verdict:
    fault, chance = FAULTS[case.fault], random.Random(f"{seed} {case.number} {case.fault}")
    scenario = SCENARIOS[case.scenario].patient(patience)
    with sandbox() as box:
        box.notes["participants"] = scenario.participants
        box.notes["step_s"] = scenario.step_s
        box.notes["grace_s"] = ORPHAN_GRACE_S if patience <= 1.0 else HANG_S
        box.notes["reference"] = None if undisturbed is None else undisturbed.sha256
        before = fault.prepare(box, chance) if fault.prepare else None
        words = (
            scenario.endless(case.scenario)
            if fault.endless
            else scenario.arguments(case.scenario, scenario.duration)
        )
        # A report takes as long as the run was, which would hide how long the end took.
        words += [*fault.arguments, *([] if case.moment == "end" else ["--no-report"])]
        output, opened = open_stream(fault.stdout)
        errors, opened_too = open_stream(fault.stderr)
        # The reader's end of stdout comes last: a fault may close it.
        box.notes["opened"] = opened_too + opened
        box.start(words, stdout=output, stderr=errors, before=before, environment=fault.environment)
        _await_moment(box, case.moment, chance)
        box.faulted_at = time.monotonic()
        fault.strike(box, chance)
        # What strikes may have to start first, or wait between two blows.
        box.faulted_at = time.monotonic()
        verdict = judge(box, fault, _limit_s(case, undisturbed, patience))
        for descriptor in box.notes["opened"]:
            os.close(descriptor)
    return verdict


def _await_moment(box: Sandbox, moment: str, chance: random.Random) -> None:
    if moment == "start":
        box.wait_for(box.takes_signals, HANG_S)
        time.sleep(chance.uniform(0.0, 2.0))
        return
    box.notes["stepped"] = box.wait_for(box.is_stepping, HANG_S)
    if moment == "middle":
        time.sleep(chance.uniform(0.0, 0.3))
    else:
        box.wait_for(lambda: result(box.out) is not None, HANG_S)
        time.sleep(chance.uniform(0.0, 0.6))


def _limit_s(case: Case, undisturbed: Reference | None, patience: float) -> float:
    """Return how long after the fault a run may take [s]: its deadlines and 2 s.

    A run that ends by itself has its own time besides, thrice: others may be at work. With
    patience, only what hangs is late: how fast the machine is decides nothing.
    """
    fault, scenario = FAULTS[case.fault], SCENARIOS[case.scenario].patient(patience)
    working = 0.0 if undisturbed is None else 15.0 + 3.0 * undisturbed.seconds
    # A participant may spawn in time, and then not join.
    start = 2.0 * scenario.start_s if case.moment == "start" else 0.0
    # A stopped participant misses its deadline, and then that of the end.
    margin = MARGIN_S if patience <= 1.0 else HANG_S
    return 2.0 * scenario.step_s + margin + start + working + patience * fault.takes_s
