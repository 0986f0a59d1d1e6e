"""Many simulated runs: drawn, in processes beside each other, and what fails shrunk."""

import os
import re
import shutil
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from pathlib import Path
from random import Random
from typing import NamedTuple

from stepbus_schemas import reached_marks

from .draw import Draw, draw_knobs
from .execution import Execution
from .follow_up import FOLLOW_UPS
from .judge import judge
from .kinds import KINDS, arm
from .programs import SCENARIOS
from .shrink import shrink
from .tape import FOLDER, ORCHESTRATOR, Fault, Tape

_ISOLATION = 0.5
_THEN = [*([""] * 27), *FOLLOW_UPS]


def draw_tape(seed: int, number: int) -> Tape:
    """Return a tape; the same one for the same numbers."""
    random = Random(f"{seed}/{number}")
    steps = random.choice([50, 50, 50, 80, 120])
    kinds = random.sample(list(KINDS), random.choice([1, 1, 2, 3, 5]))
    needed = [KINDS[kind].needs for kind in kinds if KINDS[kind].needs]
    name = random.choice(needed or list(SCENARIOS))
    names, knobs = list(SCENARIOS[name]), draw_knobs(random)
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


class Outcome(NamedTuple):
    """What became of a tape.

    code: the exit code, `refused` or `killed`. kinds: of the faults that struck. problem: what did
    not hold; empty: all did. marks: that its process has reached so far.
    """

    tape: Tape
    code: str
    kinds: frozenset[str]
    problem: str
    marks: set[str]


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


def run_number(seed: int, number: int) -> Outcome:
    """Return what became of a tape of a seed."""
    execution, problems = execute(draw_tape(seed, number))
    code = "refused" if execution.refusal is not None else "killed"
    if execution.result is not None:
        code = str(int(execution.result.exit_code))
    kinds = frozenset(fault.kind for fault in execution.effective)
    problem = problems[0] if problems else ""
    return Outcome(execution.tape, code, kinds, problem, reached_marks())


def campaign(seed: int, runs: int) -> Iterator[Outcome]:
    """Yield what became of the tapes of a seed, in order; each processor runs some."""
    with ProcessPoolExecutor() as pool:
        yield from pool.map(run_number, repeat(seed), range(runs), chunksize=20)


def shortest(tape: Tape, problem: str) -> tuple[Tape, str]:
    """Return the shortest tape that fails in the same way, and what does not hold of it."""
    kind = fingerprint(problem)

    def failing(tape: Tape) -> list[str]:
        return [one for one in execute(tape)[1] if fingerprint(one) == kind]

    tape = shrink(tape, lambda tape: bool(failing(tape)))
    return tape, next(iter(failing(tape)), problem)
