"""Makes recordings, damages them, and has them read."""

from __future__ import annotations

import random
import subprocess
import tempfile
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..sandbox import STEPBUS
from ..scenarios import SCENARIOS
from .mutations import MUTATIONS, Mutation, rewritten
from .readers import PROCESSES, READERS, Answer, Reader, Task
from .verdict import Judge

SOURCES = {
    # scenario: (the participant that is replayed, seconds of simulation)
    "two_link": ("controller", "500ms"),
    "two_link/encoders": ("controller", "300ms"),
    "baxter": ("controller", "200ms"),
    "store/truth": ("controller", "320ms"),
}
_LONGEST_S = 1200.0
_PROCESS_EVERY = 25
"""Of so many recordings, one is read by a process of its own, by one of its commands in turn."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of one mutated recording. reported: whether `recover` found damage or holes."""

    number: int
    mutation: str
    source: str
    calls: int
    reported: bool
    broken: list[str] = field(default_factory=list)


def mutate(count: int, seed: int) -> Iterator[Outcome]:
    """Mutate `count` recordings and yield what came of each."""
    with tempfile.TemporaryDirectory(prefix="sbc-") as name:
        folder = Path(name)
        sources = {scenario: _record(scenario, folder) for scenario in SOURCES}
        for number in range(count):
            scenario = random.Random(f"{seed} {number}").choice(list(SOURCES))
            yield _mutate_one(number, seed, scenario, sources[scenario])


def _record(scenario: str, folder: Path) -> list[Path]:
    """Return two recordings of a scenario: as it was made, and in small chunks."""
    out = folder / scenario.replace("/", "-")
    # However slow the machine is: it is not this that is judged.
    patient = replace(SCENARIOS[scenario], start_s=300.0, step_s=60.0)
    words = ["run", *patient.arguments(scenario, SOURCES[scenario][1]), "--no-report"]
    command = [STEPBUS, *words, "--out", str(out)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=_LONGEST_S)
    if done.returncode:
        said = (done.stdout + done.stderr)[-2000:]
        raise RuntimeError(f"{scenario} cannot be recorded: exit code {done.returncode}: {said}")
    path, small = out / "run.mcap", out / "small.mcap"
    small.write_bytes(rewritten(random.Random(0), path.read_bytes()))
    return [path, small]


def _mutate_one(number: int, seed: int, scenario: str, sources: list[Path]) -> Outcome:
    mutation = MUTATIONS[number % len(MUTATIONS)]
    chance = random.Random(f"{seed} {number} {mutation.__name__}")
    # Mutations of chunks need several.
    original = sources[1] if "chunk" in mutation.__name__ else chance.choice(sources)
    readers: dict[str, Reader] = dict(READERS)
    if number % _PROCESS_EVERY == 0:
        name = list(PROCESSES)[number // _PROCESS_EVERY % len(PROCESSES)]
        readers[name] = PROCESSES[name]
    with tempfile.TemporaryDirectory(prefix="sbc-") as folder:
        task = Task(Path(folder) / "run.mcap", original, Path(folder), SOURCES[scenario][0])
        answers, broken = _read(task, mutation, chance, readers)
    return Outcome(
        number=number, mutation=mutation.__name__.replace("_", " "), source=scenario,
        calls=len(readers), reported=": undamaged" not in answers["recover"].text, broken=broken,
    )  # fmt: skip


def read_all(
    mutation: Mutation, chance: random.Random, original: Path, folder: Path, participant: str
) -> list[str]:
    """Mutate one recording in small chunks, and return what its readers say that is wrong.

    folder: to write to. participant: the one that is replayed.
    """
    small = folder / "small.mcap"
    small.write_bytes(rewritten(chance, original.read_bytes()))
    task = Task(folder / "run.mcap", small, folder, participant)
    return _read(task, mutation, chance, READERS)[1]


def _read(
    task: Task, mutation: Mutation, chance: random.Random, readers: Mapping[str, Reader]
) -> tuple[dict[str, Answer], list[str]]:
    """Return what each reader answers, and what is wrong with it."""
    before = task.original.read_bytes()
    data = mutation(chance, before)
    task.path.write_bytes(data)
    judge = Judge(mutation, before, data, task.participant)
    answers = {name: _call(reader, task) for name, reader in readers.items()}
    return answers, [line for name, answer in answers.items() for line in judge.judge(name, answer)]


def _call(reader: Reader, task: Task) -> Answer:
    try:
        return reader(task)
    except Exception:  # noqa: BLE001  (any would have been a traceback)
        return Answer(1, traceback.format_exc())
