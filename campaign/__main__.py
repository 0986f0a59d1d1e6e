"""`python -m campaign`: strikes runs from outside, judges them, prints the table."""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from .faults import FAULTS, Fault, stdout_of
from .judge import Verdict, judge
from .log_reader import result
from .sandbox import STEPBUS, Sandbox, sandbox

DEADLINE_S = 2.0
START_S = 8.0
"""Deadlines of the runs: of a step, and of each phase of the start [s]."""

SCENARIOS = {
    # name: (participants, seconds of simulation until a run ends by itself)
    "two_link": (("plant", "controller", "mission"), "10s"),
    "two_link/pd": (("plant", "controller", "mission"), "10s"),
    "two_link/encoders": (("plant", "controller", "mission"), "10s"),
    "baxter": (("plant", "controller", "mission"), "10s"),
}


def arguments(scenario: str, duration: str) -> list[str]:
    """Return the arguments of a run with short deadlines."""
    participants, _ = SCENARIOS[scenario]
    deadlines = [
        f"{name}.{phase}_timeout={seconds:g}s"
        for name in participants
        for phase, seconds in (
            ("spawn", START_S), ("join", START_S), ("ready", START_S),
            ("step", DEADLINE_S), ("stop", DEADLINE_S),
        )
    ]  # fmt: skip
    sets = [f"duration={duration}", *deadlines]
    return [scenario, *(word for item in sets for word in ("--set", item))]


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run, and what strikes it when."""

    number: int
    fault: str
    scenario: str
    moment: str


def run_case(case: Case, seed: int, reference: str) -> Verdict:
    """Run one scenario, strike, and judge; reference: SHA-256 of an undisturbed run."""
    fault, chance = FAULTS[case.fault], random.Random(f"{seed} {case.number} {case.fault}")
    participants, finite = SCENARIOS[case.scenario]
    with sandbox() as box:
        box.notes["participants"] = participants
        if not fault.endless and not fault.prepare:
            box.notes["reference"] = reference or None
        before = fault.prepare(box, chance) if fault.prepare else None
        duration = "1000s" if fault.endless else finite
        # A report takes as long as the run was, which would hide how long the end took.
        words = [*arguments(case.scenario, duration), *fault.arguments]
        words += ["--no-report"] if fault.endless else []
        descriptor, opened = stdout_of(fault.stdout)
        box.start(words, stdout=descriptor, before=before)
        _await_moment(box, case.moment, chance)
        box.faulted_at = time.monotonic()
        fault.strike(box, chance)
        verdict = judge(box, fault, _limit_s(fault, case.moment))
        for link in box.notes.get("sockets", []):
            link.close()
        for item in opened:
            os.close(item)
        if verdict.broken:
            verdict.broken.append(
                f"   output: {(box.text('stderr') + box.text('stdout')).strip()[-300:]!r}"
            )
    return verdict


def _await_moment(box: Sandbox, moment: str, chance: random.Random) -> None:
    if moment == "start":
        time.sleep(chance.uniform(0.0, 1.2))
        return
    box.wait_for(box.is_stepping, 20.0)
    box.notes["stepped"] = True
    if moment == "middle":
        time.sleep(chance.uniform(0.0, 0.15))
    else:
        box.wait_for(lambda: result(box.out) is not None, 30.0)
        time.sleep(chance.uniform(0.0, 0.6))


def _limit_s(fault: Fault, moment: str) -> float:
    """Return how long after the fault a run may take [s]: its deadline and 2 s."""
    working = 0.0 if fault.endless else 25.0
    start = START_S if moment == "start" else 0.0
    return DEADLINE_S + 2.0 + start + working + fault.takes_s


def cases(count: int, seed: int) -> list[Case]:
    """Return the cases, every type of fault in turn."""
    chance = random.Random(seed)
    names = list(FAULTS)
    rows = []
    for number in range(count):
        name = names[number % len(names)]
        scenario, moment = chance.choice(list(SCENARIOS)), chance.choice(FAULTS[name].when)
        rows.append(Case(number=number, fault=name, scenario=scenario, moment=moment))
    return rows


def references() -> dict[str, str]:
    """Return the SHA-256 of an undisturbed run of each scenario."""
    found = {}
    for scenario, (_, duration) in SCENARIOS.items():
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "run"
            words = [*arguments(scenario, duration), "--no-report", "--out", str(out)]
            subprocess.run([STEPBUS, "run", *words], check=True, capture_output=True, timeout=120)
            content = result(out)
            found[scenario] = content["sha256"] if content else ""
    return found


def main() -> int:
    """Run the campaign; return 1 when a promise was broken."""
    parser = argparse.ArgumentParser(prog="python -m campaign", description=__doc__)
    parser.add_argument("--count", type=int, default=330, help="how many cases (default: 330)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="only faults whose name has this in it")
    parser.add_argument("--table", type=Path, help="write the table as Markdown to this file")
    options = parser.parse_args()
    rows = [case for case in cases(options.count, options.seed) if options.only in case.fault]
    expected = references()
    done: Counter[str] = Counter()
    broken: Counter[str] = Counter()
    slowest: dict[str, float] = {}
    for case in rows:
        name = case.fault
        verdict = run_case(case, options.seed, expected[case.scenario])
        done[name] += 1
        slowest[name] = max(slowest.get(name, 0.0), verdict.seconds)
        if verdict.broken:
            broken[name] += 1
            sys.stdout.write(
                f"#{case.number} {name}, {case.scenario}, {case.moment} (code {verdict.code}):\n"
            )
            sys.stdout.writelines(f"    {line}\n" for line in verdict.broken)
        sys.stdout.flush()
    lines = [
        "| Fault from outside | Cases | Promise broken | Slowest end [s] |",
        "|---|---|---|---|",
    ]
    lines += [f"| {n} | {done[n]} | {broken[n]} | {slowest[n]:.1f} |" for n in FAULTS if done[n]]
    lines.append(f"| **all** | {sum(done.values())} | {sum(broken.values())} | |")
    text = "\n".join(lines) + "\n"
    sys.stdout.write(text)
    if options.table:
        options.table.write_text(text)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
