"""Many simulated runs: in processes beside each other, counted, and what fails shrunk."""

import gc
import os
import re
import shutil
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from stepbus_participant import format_duration
from stepbus_schemas import reached_marks

from .execution import Execution
from .judge import judge
from .kinds import KINDS, arm
from .memo import memoized
from .reference import FOLDER
from .shrink import shrink
from .swarm import draw_tape
from .tape import Fault, Tape

CHUNK = 250
"""Runs that a process does before it says how far it is."""


@dataclass
class Failure:
    """A run in which something did not hold. number: of its tape. tape: the shortest such one."""

    number: int
    tape: Tape
    problem: str


@dataclass
class Count:
    """What happened in some runs.

    drawn, effective: kind → in how many runs. codes: exit code → runs. codes_of: kind → the exit
    codes of runs that it struck. marks: that were reached. then: what was done with recordings.
    """

    runs: int = 0
    simulated_s: float = 0.0
    drawn: dict[str, int] = field(default_factory=Counter)
    effective: dict[str, int] = field(default_factory=Counter)
    codes: dict[str, int] = field(default_factory=Counter)
    codes_of: dict[str, set[str]] = field(default_factory=dict)
    marks: set[str] = field(default_factory=set)
    then: dict[str, int] = field(default_factory=Counter)
    failures: list[Failure] = field(default_factory=list)

    def add(self, other: "Count") -> None:
        """Add what happened in other runs."""
        self.runs += other.runs
        self.simulated_s += other.simulated_s
        for name in ("drawn", "effective", "codes", "then"):
            setattr(self, name, Counter(getattr(self, name)) + Counter(getattr(other, name)))
        for kind, codes in other.codes_of.items():
            self.codes_of.setdefault(kind, set()).update(codes)
        self.marks |= other.marks
        self.failures += other.failures


def execute(tape: Tape, *, keeps_trace: bool = False) -> tuple[Execution, list[str]]:
    """Run a tape; return the run, and what does not hold of it."""
    # Of the same length in each run, as it stands in what is written.
    folder = Path(FOLDER) / f"stepbus-sim-{os.getpid():07}"
    folder.mkdir()
    try:
        with memoized():
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
        tape = draw_tape(seed, number)
        execution, problems = execute(tape)
        struck = {fault.kind for fault in execution.effective}
        code = _code(execution)
        one = Count(
            runs=1,
            simulated_s=execution.world.now_ns * 1e-9,
            drawn=dict.fromkeys({fault.kind for fault in tape.faults}, 1),
            effective=dict.fromkeys(struck, 1),
            codes={code: 1},
            codes_of={kind: {code} for kind in struck},
            then={tape.then or "nothing": 1},
            failures=[Failure(number, tape, problems[0])] if problems else [],
        )
        total.add(one)
    gc.collect()
    total.marks = reached_marks()
    return total


def _code(execution: Execution) -> str:
    if execution.result is not None:
        return str(int(execution.result.exit_code))
    return "refused" if execution.refusal is not None else "killed"


def campaign(seed: int, runs: int, jobs: int) -> Iterator[Count]:
    """Yield what happened, chunk by chunk, in order."""
    chunks = [(number, min(CHUNK, runs - number)) for number in range(0, runs, CHUNK)]
    with ProcessPoolExecutor(jobs) as pool:
        futures = [pool.submit(run_numbers, seed, *chunk) for chunk in chunks]
        try:
            for future in futures:
                yield future.result()
        finally:
            for future in futures:
                future.cancel()


def shortest(failure: Failure) -> Failure:
    """Return a failure with the shortest tape that fails in the same way."""
    kind = fingerprint(failure.problem)

    def fails(tape: Tape) -> bool:
        return any(fingerprint(problem) == kind for problem in execute(tape)[1])

    tape = shrink(failure.tape, fails)
    problems = [problem for problem in execute(tape)[1] if fingerprint(problem) == kind]
    return Failure(failure.number, tape, (problems or [failure.problem])[0])


def real_fault(execution: Execution, fault: Fault) -> str:
    """Return what strikes real processes like a fault of a tape; empty where nothing does."""
    # `corrupt` damages the first byte.
    if fault.kind == "garbage" and fault.amount:
        return ""
    template = KINDS[fault.kind].real
    return template.format(
        target=fault.target,
        struck=execution.struck_at.get(fault, 0),
        step=fault.at - fault.at % execution.every(fault.target) if "{step}" in template else 0,
        lasting=f" for {format_duration(fault.amount)}" if fault.amount > 0 else "",
        s=fault.amount / 1e9,
    )


def commands(execution: Execution) -> Iterator[str]:
    """Yield what strikes real processes as the faults that took effect, as far as it can be had."""
    for fault in execution.effective:
        if text := real_fault(execution, fault):
            yield text
