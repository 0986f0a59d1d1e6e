"""Recordings that are damaged or forged, and everything that reads one."""

from __future__ import annotations

import random
import traceback
from collections.abc import Iterator
from pathlib import Path

from .mutations import Mutation, rewritten
from .readers import READERS, Answer, Reader, Task
from .verdict import Judge

__all__ = ["read_all"]


def read_all(
    mutation: Mutation, chance: random.Random, original: Path, folder: Path, participant: str
) -> Iterator[str]:
    """Mutate one recording in small chunks, and yield what its readers say that is wrong.

    folder: to write to. participant: the one that is replayed.
    """
    before = rewritten(chance, original.read_bytes())
    after = mutation(chance, before)
    task = Task(folder / "run.mcap", folder / "small.mcap", folder, participant)
    task.original.write_bytes(before)
    task.path.write_bytes(after)
    judge = Judge(mutation, before, after)
    for name, reader in READERS.items():
        yield from judge.judge(name, _call(reader, task))


def _call(reader: Reader, task: Task) -> Answer:
    try:
        return reader(task)
    except Exception:  # noqa: BLE001  (any would have been a traceback)
        return Answer(1, traceback.format_exc())
