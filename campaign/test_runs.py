"""The first part: runs of the scenarios that ship, struck from outside."""

from __future__ import annotations

import itertools
import random
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import pytest

from .faults import FAULTS, Fault
from .judge import ORPHAN_GRACE_S, Verdict, judge
from .log_reader import result
from .sandbox import STEPBUS, Missed, Sandbox, sandbox

WHOLE = len(FAULTS)
"""Cases of a whole campaign: each fault once."""
MARGIN_S = 2.0
"""How much later than its deadline a run may end [s]."""
HANG_S = 120.0
"""After so long, something hangs on the slowest machine [s]."""
_ATTEMPTS = 4
_LONGEST_S = 600.0


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One scenario that ships.

    participants: their names. duration: of a run that ends by itself. start_s, step_s: deadlines
    of each phase of the start, and of a step and of the end [s]. still: settings of a run that ends
    by the fault only.
    """

    participants: tuple[str, ...] = ("plant", "controller", "mission")
    duration: str = "60s"
    start_s: float = 15.0
    step_s: float = 3.0
    still: tuple[str, ...] = ()

    def arguments(self, name: str, *, endless: bool, patience: float) -> list[str]:
        """Return the arguments of a run; endless: it ends by the fault. See also `_limit_s`."""
        phases = dict.fromkeys(("spawn", "join", "ready"), patience * self.start_s)
        phases |= dict.fromkeys(("step", "stop"), patience * self.step_s)
        sets = [f"duration={'1000s' if endless else self.duration}"]
        sets += [
            f"{participant}.{phase}_timeout={seconds:g}s"
            for participant in self.participants
            for phase, seconds in phases.items()
        ]
        sets += self.still if endless else ()
        return [name, *(word for item in sets for word in ("--set", item))]


# Without a script nothing ends a sale before the fault does.
_STORE = Scenario(
    participants=("plant", "perception", "mission", "controller", "planner"), duration="4800ms",
    start_s=30.0, step_s=6.0, still=("plant.params.script=[]",),
)  # fmt: skip
_SENSED = replace(_STORE, participants=(*_STORE.participants, "world"))
_ARMS = ("", "/pd", "/pid", "/pd_gravity", "/velocity_force", "/encoders")
SCENARIOS: Mapping[str, Scenario] = {
    **{f"two_link{name}": Scenario() for name in _ARMS},
    "baxter": Scenario(),
    "baxter/round_trip": Scenario(),
    **{f"store/{name}": _STORE for name in ("truth", "obstacle", "heavy", "no_path")},
    # A wheel jams at 1.5 s; soon afterwards the sale fails, as it should.
    "store/jammed": replace(_STORE, duration="1792ms"),
    "store": _SENSED,
    "store/dead_camera": _SENSED,
}


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run, and what strikes it when."""

    fault: str
    scenario: str
    moment: str

    def __str__(self) -> str:
        return f"{self.fault}, {self.scenario}, {self.moment}"


def cases(seed: int, count: int = WHOLE) -> list[Case]:
    """Return the cases: every fault once, on all scenarios, at all moments."""
    chance = random.Random(seed)
    faults = chance.sample(list(FAULTS), WHOLE)[:count]
    scenarios = itertools.cycle(chance.sample(list(SCENARIOS), len(SCENARIOS)))
    return [
        Case(fault=fault, scenario=next(scenarios), moment=chance.choice(FAULTS[fault].when))
        for fault in faults
    ]


@pytest.mark.timeout(3600)
def test_run_keeps_its_promises(
    case: Case, pytestconfig: pytest.Config, record_property: Callable[[str, object], None]
) -> None:
    """Strike a run, and judge it; skip the case where the run ended before the fault."""
    seed, patience = pytestconfig.getoption("--seed"), pytestconfig.getoption("--patience")
    verdict = run_case(case, seed, patience)
    record_property("exit code", verdict.code)
    record_property("end [s]", round(verdict.seconds, 1))
    if verdict.broken:
        said = [f"reason: {verdict.said}", f"output: {verdict.output[-400:]!r}"]
        pytest.fail("\n".join([*verdict.broken, *said]), pytrace=False)
    if verdict.missed:
        pytest.skip("the run ended before the fault")


@cache
def reference(name: str, patience: float) -> tuple[str, float]:
    """Run a scenario undisturbed, once; return the SHA-256 of its recording, and its time [s].

    Raises RuntimeError where it does not finish.
    """
    words = SCENARIOS[name].arguments(name, endless=False, patience=patience)
    # The deadlines are in the recording, so they must be the same, also on a machine that is busy.
    for _ in range(_ATTEMPTS):
        with tempfile.TemporaryDirectory(prefix="sbc-") as folder:
            out, began = Path(folder) / "run", time.monotonic()
            command = [STEPBUS, "run", *words, "--no-report", "--out", str(out)]
            done = subprocess.run(
                command, check=False, capture_output=True, text=True, timeout=_LONGEST_S
            )
            content, seconds = result(out), time.monotonic() - began
        if not done.returncode and content is not None:
            return content["sha256"], seconds
    said = (done.stdout + done.stderr)[-2000:]
    raise RuntimeError(f"the undisturbed run failed: exit code {done.returncode}: {said}")


def run_case(case: Case, seed: int, patience: float) -> Verdict:
    """Run one scenario, strike, and judge; again where the run ended before the fault."""
    undisturbed = None if FAULTS[case.fault].endless else reference(case.scenario, patience)
    for attempt in range(_ATTEMPTS):
        chance = random.Random(f"{seed} {attempt} {case}")
        verdict = _run_once(case, chance, patience, undisturbed)
        if not verdict.missed:
            break
    return verdict


def _run_once(
    case: Case, chance: random.Random, patience: float, undisturbed: tuple[str, float] | None
) -> Verdict:
    fault, scenario = FAULTS[case.fault], SCENARIOS[case.scenario]
    with sandbox() as box:
        box.notes["participants"] = scenario.participants
        box.notes["grace_s"] = ORPHAN_GRACE_S if patience <= 1.0 else HANG_S
        box.notes["reference"] = undisturbed and undisturbed[0]
        before = fault.prepare(box, chance) if fault.prepare else None
        words = scenario.arguments(case.scenario, endless=fault.endless, patience=patience)
        words += fault.arguments
        # A report takes as long as the run was, which would hide how long the end took.
        words += [] if case.moment == "end" else ["--no-report"]
        box.start(words, before)
        _await_moment(box, case.moment, chance)
        box.faulted_at = time.monotonic()
        box.notes["missed"] = not has_struck(box, fault, chance)
        # What strikes may have to start first, or wait between two blows.
        box.faulted_at = time.monotonic()
        return judge(box, fault, _limit_s(case, undisturbed, patience))


def has_struck(box: Sandbox, fault: Fault, chance: random.Random) -> bool:
    """Strike; return False where the run ended before."""
    if fault.strike is None:
        return True
    if box.orchestrator.poll() == 0:
        return False
    try:
        fault.strike(box, chance)
    except Missed:
        return False
    return True


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


def _limit_s(case: Case, undisturbed: tuple[str, float] | None, patience: float) -> float:
    """Return how long after the fault a run may take [s]: its deadlines and 2 s.

    A run that ends by itself has its own time besides, thrice: others may be at work. With
    patience, only what hangs is late: how fast the machine is decides nothing.
    """
    fault, scenario = FAULTS[case.fault], SCENARIOS[case.scenario]
    working = 0.0 if undisturbed is None else 15.0 + 3.0 * undisturbed[1]
    # A participant may spawn in time, and then not join.
    deadlines = 2.0 * scenario.step_s + fault.takes_s
    deadlines += 2.0 * scenario.start_s if case.moment == "start" else 0.0
    # A stopped participant misses its deadline, and then that of the end.
    margin = MARGIN_S if patience <= 1.0 else HANG_S
    return patience * deadlines + margin + working
