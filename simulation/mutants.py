"""Breaks the sources on purpose, and counts after how many runs the simulator shows it.

`python simulation/mutants.py` takes out mends that were made, one after the other. With
`--drawn N` it has cosmic-ray change one operator, number or condition at a time in the modules of
the barrier, the deadlines, the admission, the recorder, the step loop and `recover`. Each mutant is
a copy of the sources.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
_O = "orchestrator/stepbus_orchestrator"
_P = "participant/stepbus_participant"
_PACKAGES = ("orchestrator", "participant", "schemas", "api", "simulation")

MENDS = {
    "a stopped subscriber blocks the announcer": (
        f"{_O}/processes/watchdog.py", "if self._blocked_s > self._limit_s:", "if False:",
    ),
    "a hole after the disk was full for a moment": (
        f"{_O}/recording/mcap_file.py", "if self._refusal is not None:", "if False:",
    ),
    "a removed folder ends finished": (
        f"{_O}/recording/mcap_file.py", "        if changed:\n", "        if False:\n",
    ),
    "a killed orchestrator loses more than 0.25 s": (
        f"{_O}/run/run.py", "if self._ticks % _FLUSH_EVERY == 0:", "if self._ticks % 40 == 0:",
    ),
    "a participant that has ended after its closing outputs is blamed": (
        f"{_O}/run/run.py", "if self.state.phase.is_stopping:\n            return", "pass",
    ),
    "a replaced participant's old message counts": (
        f"{_O}/run/kernel/messages.py", "self._state.replaced", "None",
    ),
    "a late error at close ends a run": (
        f"{_O}/recording/reserved_file.py",
        "            with contextlib.suppress(OSError):\n                self._disk.close(reserve)",
        "            self._disk.close(reserve)",
    ),
    "a participant waits for an orchestrator that has died": (
        f"{_P}/session/session.py", "watch=watch", "watch=Watch(bus)",
    ),
    "a chain is missing where a run was aborted": (
        f"{_O}/recording/recorder.py",
        "range(min(self._next, *steps), steps[-1] + 1) if steps else ()", "steps",
    ),
    "a branch counts steps that only some have done": (
        f"{_O}/replay/branch_change.py", " or planned is None or end < planned", "",
    ),
    "a branch counts steps whose bulk content is missing": (
        f"{_O}/replay/branch_change.py", " or has_failed", "",
    ),
    "one is replaced for a message that the recorder found": (
        f"{_O}/run/phases.py", "run.recorder.has_broken(exc.participant) or ", "",
    ),
    "a participant hears nothing of an orchestrator that died at its welcome": (
        f"{_P}/session/control.py", "        if self._is_lost:\n            on_lost()\n", "",
    ),
    "one is blamed at the start that a stopped reader blocks": (
        f"{_O}/run/kernel/deadlines.py", ", *_readers(participant, participants))", ",)",
    ),
    "one that is killed for reading nothing at the end has died": (
        f"{_O}/run/phases.py", " or one.name in run.killed", "",
    ),
    "something is recorded behind bulk content that never came": (
        f"{_O}/recording/sink.py", "takewhile(partial(self._has_bulk, name), own)", "own",
    ),
    "what a torn write leaves behind it is read again": (
        f"{_O}/recording/scanner.py", "if message.sequence < self._done:", "if False:",
    ),
    "the note of a fallback takes what is written ahead from the file": (
        f"{_O}/recording/message_writer.py", "if at == offset and known:", "if False:",
    ),
    "one is blamed in a step that a stopped reader blocks": (
        f"{_O}/run/kernel/deadlines.py", "_readers(one, others)", "()",
    ),
    "a stopped reader is blamed for one that is stopped too": (
        f"{_O}/run/kernel/deadlines.py", "near = (participant, *sources", "near = (*sources",
    ),
}  # fmt: skip
"""What comes back → the file, and what is changed in it."""

_LEFT_OUT = {"VariableInserter", "VariableReplacer", "RemoveDecorator"}
MODULES = (
    f"{_O}/run/kernel/barrier.py",
    f"{_O}/run/kernel/deadlines.py",
    f"{_O}/run/kernel/admission.py",
    f"{_O}/recording/recorder.py",
    f"{_O}/recording/sink.py",
    f"{_O}/recording/recover.py",
    f"{_P}/session/step_loop.py",
)
_RUN = """
import json, sys
from pathlib import Path
from stepbus_simulation.campaign import execute, first_failure
from stepbus_simulation.costs import costs
if costs() != json.load(open(sys.argv[3])):
    sys.exit("undisturbed runs cost something else")
from stepbus_simulation.tape import load_tape
for path in sorted(Path(sys.argv[3]).parent.glob("tapes/*.json")):
    for problem in execute(load_tape(path))[1]:
        sys.exit(f"{path.stem}: {problem}")
failure = first_failure(int(sys.argv[1]), int(sys.argv[2]))
if failure is not None:
    sys.exit(f"run {failure.number}: {failure.problem}")
"""
_COSTS = str(ROOT / "tests/simulation/costs.json")
_REASONS = ROOT / "simulation/survivors.json"
"""Why some are not shown: name, without the line, → the reason."""
_SLOWEST_RUN_S = 0.2


class Mutant(NamedTuple):
    """One change of the sources."""

    name: str
    path: str
    text: str


def mends(names: list[str]) -> Iterator[Mutant]:
    """Yield a mutant for each mend."""
    for name in names or MENDS:
        path, old, new = MENDS[name]
        text = (ROOT / path).read_text(encoding="utf-8")
        if old not in text:
            sys.exit(f"{path} has no {old!r}")
        yield Mutant(name, path, text.replace(old, new))


def drawn(count: int, seed: int) -> list[Mutant]:
    """Return mutants that cosmic-ray makes: one change at each place, drawn from all there are."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator, operator_names

    random = Random(seed)
    mutants = []
    for path in MODULES:
        text = (ROOT / path).read_text(encoding="utf-8")
        places: dict[tuple[str, Any], list[tuple[str, int]]] = {}
        for operator_name in operator_names():
            # A type `A | B` is no operation. Of a decorator or a class, a change is one of style.
            family = operator_name.partition("/")[2].split("_")[0]
            if "BitOr" in operator_name or family in _LEFT_OUT:
                continue
            operator, number = get_operator(operator_name)(), 0
            for node in ast_nodes(get_ast(text)):
                for position, _ in operator.mutation_positions(node):
                    places.setdefault((family, position), []).append((operator_name, number))
                    number += 1
        lines = [line.strip() for line in text.splitlines()]
        for (_, position), choices in places.items():
            line = lines[position[0] - 1]
            if line.startswith(("@", "class ")):
                continue
            operator_name, number = random.choice(choices)
            mutated = mutate_code(text, get_operator(operator_name)(), number)
            if mutated and mutated != text:
                name = f"{path.rpartition('/')[2]}:{position[0]} {operator_name[5:]}: {line}"
                mutants.append(Mutant(name, path, mutated))
    return random.sample(mutants, min(count, len(mutants)))


class Trials:
    """Runs mutants; each thread has a copy of the sources of its own."""

    def __init__(self, folder: Path, runs: int, seed: int) -> None:
        self._folder, self._runs, self._seed = folder, runs, seed
        self._own = threading.local()

    def try_one(self, mutant: Mutant) -> str:
        """Return what shows that the sources are broken; empty where nothing does."""
        if not hasattr(self._own, "copy"):
            self._own.copy = Path(tempfile.mkdtemp(dir=self._folder))
            for package in _PACKAGES:
                shutil.copytree(ROOT / package, self._own.copy / package)
        file = self._own.copy / mutant.path
        before = file.read_bytes()
        file.write_text(mutant.text, encoding="utf-8")
        paths = [str(self._own.copy / package) for package in _PACKAGES]
        try:
            done = subprocess.run(
                [sys.executable, "-B", "-c", _RUN, str(self._seed), str(self._runs), _COSTS],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                timeout=60 + self._runs * _SLOWEST_RUN_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return "it does not end"
        finally:
            file.write_bytes(before)
        text = done.stderr.decode(errors="replace").strip().splitlines()
        return (text or [f"exit code {done.returncode}"])[-1] if done.returncode else ""


def _without_line(name: str) -> str:
    """Return the name of a mutant without the number of its line, which any change moves."""
    file, _, rest = name.partition(":")
    return f"{file} {rest.partition(' ')[2]}"


def main() -> int:
    """Try the mutants; return how many were not shown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("mends", nargs="*", help="names of the fixes to revert (default: all)")
    parser.add_argument(
        "--drawn", type=int, default=0, metavar="N", help="number of changes to draw"
    )
    parser.add_argument(
        "--runs", type=int, default=10_000, help="runs per change (default: 10,000)"
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="seed of the changes and the runs (default: 1)"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes in parallel (default: 2)")
    parser.add_argument(
        "--again",
        type=Path,
        help="repeat only the changes in this output file that have no recorded reason",
    )
    parser.add_argument(
        "--out", type=Path, help="file to append the outcomes to, one JSON object per line"
    )
    options = parser.parse_args()
    mutants = drawn(options.drawn, options.seed) if options.drawn else list(mends(options.mends))
    reasons = json.loads(_REASONS.read_text(encoding="utf-8"))
    if options.again:
        rows = map(json.loads, options.again.read_text(encoding="utf-8").splitlines())
        missed = {name for name, shown in rows if not shown}
        missed = {name for name in missed if _without_line(name) not in reasons}
        mutants = [mutant for mutant in mutants if mutant.name in missed]
    survivors = 0
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.jobs) as pool:
        trials = Trials(Path(folder), options.runs, options.seed)
        for mutant, shown in zip(mutants, pool.map(trials.try_one, mutants), strict=True):
            survivors += not shown
            why = shown[:150] or reasons.get(_without_line(mutant.name), "")
            print(f"{'shown  ' if shown else 'MISSED '} {mutant.name}\n        {why}", flush=True)
            if options.out:
                with options.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([mutant.name, shown]) + "\n")
    print(f"{len(mutants)} mutants, {survivors} of them not shown in {options.runs} runs")
    return survivors


if __name__ == "__main__":
    sys.exit(main())
