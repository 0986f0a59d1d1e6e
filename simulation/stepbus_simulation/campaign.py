"""Many simulated runs: drawn, in processes beside each other, counted, and what fails shrunk."""

import gc
import os
import re
import shutil
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from stepbus_schemas import reached_marks

from .draw import Draw, draw_knobs
from .execution import Execution
from .follow_up import FOLLOW_UPS
from .judge import judge
from .kinds import KINDS, arm
from .programs import SCENARIOS
from .shrink import shrink
from .tape import FOLDER, ORCHESTRATOR, Fault, Tape

CHUNK = 250
"""Runs that a process does before it says how far it is."""

_ISOLATION = 0.5
_THEN = [*([""] * 27), *FOLLOW_UPS]
_NAMES = {name: list(make()) for name, make in SCENARIOS.items()}


def draw_tape(seed: int, number: int) -> Tape:
    """Return a tape; the same one for the same numbers."""
    random = Random(f"{seed}/{number}")
    steps = random.choice([50, 50, 50, 80, 120])
    kinds = random.sample(list(KINDS), random.choice([1, 1, 2, 3, 5]))
    needed = [KINDS[kind].needs for kind in kinds if KINDS[kind].needs]
    name = random.choice(needed or list(SCENARIOS))
    names, knobs = _NAMES[name], draw_knobs(random)
    preferred = random.choice(["", random.choice(names)])
    draw = Draw(random=random, names=names, steps=steps, preferred=preferred, knobs=knobs)
    count = min(1 + int(random.expovariate(0.7)), 8)
    faults = tuple(draw_fault(random.choice(kinds), draw) for _ in range(count))
    if "cut" in kinds and random.random() < _ISOLATION:
        faults = (*faults, *_isolation(draw))
    return Tape(name, steps, knobs, faults, random.choice(_THEN))


def draw_fault(kind: str, draw: Draw) -> Fault:
    """Return a fault of a kind."""
    return Fault(kind, *KINDS[kind].draw(draw))


def _isolation(draw: Draw) -> Iterator[Fault]:
    """Yield what cuts a process off, and heals its links one by one, in a random order."""
    one, at = draw.name(), draw.time()
    for other in [*draw.names, ORCHESTRATOR]:
        if other != one:
            yield Fault("cut", f"{one}>{other}", at, draw.lasting())


@dataclass
class Failure:
    """A run in which something did not hold. number: of its tape. tape: the shortest such one."""

    number: int
    tape: Tape
    problem: str


@dataclass
class Count:
    """What happened in some runs.

    effective: kind → runs that it struck. codes: exit code → runs. codes_of: kind → the exit codes
    of runs that it struck. marks: that were reached. then: what was done with recordings.
    """

    runs: int = 0
    simulated_s: float = 0.0
    effective: Counter[str] = field(default_factory=Counter)
    codes: Counter[str] = field(default_factory=Counter)
    codes_of: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    marks: set[str] = field(default_factory=set)
    then: Counter[str] = field(default_factory=Counter)
    failures: list[Failure] = field(default_factory=list)

    def add(self, other: "Count") -> None:
        """Add what happened in other runs."""
        self.runs += other.runs
        self.simulated_s += other.simulated_s
        self.effective.update(other.effective)
        self.codes.update(other.codes)
        self.then.update(other.then)
        for kind, codes in other.codes_of.items():
            self.codes_of[kind] |= codes
        self.marks |= other.marks
        self.failures += other.failures

    def add_run(self, number: int, execution: Execution, problems: list[str]) -> None:
        """Add one run."""
        self.runs += 1
        self.simulated_s += execution.world.now_ns * 1e-9
        code = "refused" if execution.refusal is not None else "killed"
        if execution.result is not None:
            code = str(int(execution.result.exit_code))
        self.codes[code] += 1
        self.then[execution.tape.then or "nothing"] += 1
        for kind in {fault.kind for fault in execution.effective}:
            self.effective[kind] += 1
            self.codes_of[kind].add(code)
        if problems:
            self.failures.append(Failure(number, execution.tape, problems[0]))


def execute(tape: Tape, *, keeps_trace: bool = False) -> tuple[Execution, list[str]]:
    """Run a tape; return the run, and what does not hold of it."""
    # Of the same length in each run, as it stands in what is written.
    folder = Path(FOLDER) / f"stepbus-sim-{os.getpid():07}"
    folder.mkdir()
    try:
        execution = Execution(tape, folder / "run", keeps_trace=keeps_trace)
        arm(execution)
        execution.run()
        return execution, list(judge(execution))
    finally:
        shutil.rmtree(folder)


def fingerprint(problem: str) -> str:
    """Return what is the same in a problem of the same kind."""
    return re.sub(r"\S*/\S*|\d+(\.\d+)?", "#", problem)[:60]


def run_numbers(seed: int, first: int, count: int) -> Count:
    """Run the tapes of some numbers."""
    total = Count()
    for number in range(first, first + count):
        total.add_run(number, *execute(draw_tape(seed, number)))
    gc.collect()
    total.marks = reached_marks()
    return total


def campaign(seed: int, runs: int, jobs: int) -> Iterator[Count]:
    """Yield what happened, chunk by chunk, in order."""
    chunks = [(number, min(CHUNK, runs - number)) for number in range(0, runs, CHUNK)]
    with ProcessPoolExecutor(jobs) as pool:
        futures = [pool.submit(run_numbers, seed, *chunk) for chunk in chunks]
        try:
            for future in futures:
                yield future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def shortest(failure: Failure) -> Failure:
    """Return a failure with the shortest tape that fails in the same way."""
    kind = fingerprint(failure.problem)

    def fails(tape: Tape) -> bool:
        return any(fingerprint(problem) == kind for problem in execute(tape)[1])

    tape = shrink(failure.tape, fails)
    problems = [problem for problem in execute(tape)[1] if fingerprint(problem) == kind]
    return Failure(failure.number, tape, (problems or [failure.problem])[0])
