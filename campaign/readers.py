"""Every command and function that reads a recording, called on one that is damaged or forged.

The commands are called in this process, as `stepbus` calls them; each returns what it printed.
"""

from __future__ import annotations

import contextlib
import io
import random
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mcap.reader import make_reader

from stepbus_orchestrator.cli.dispatch import execute
from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.replay.prepare import prepare, shorten
from stepbus_orchestrator.replay.replay_result import inputs_of
from stepbus_orchestrator.replay.sources import Sources
from stepbus_orchestrator.run.extensions.calls import recorded_calls
from stepbus_schemas import StepbusError
from stepbus_tools.columns import readable
from stepbus_tools.conformance import material
from stepbus_tools.report.curves import PortCurves, read_ports
from stepbus_tools.report.summary import read_joints

from .log_reader import CHAIN, parse
from .log_reader import DAMAGE as UNREADABLE
from .mutations import DAMAGE, FORGED, MUTATIONS


@dataclass(frozen=True)
class Answer:
    """What a reader came to: exit code and output; of a function, 2 and the error's sentence."""

    code: int
    text: str


@dataclass(frozen=True)
class Task:
    """What is read: the recording, the one it was made from, and a folder to write to."""

    path: Path
    original: Path
    folder: Path
    participant: str


Reader = Callable[[Task], Answer]


def command(*words: object) -> Answer:
    """Call a command in this process; what escapes from it would be a traceback."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        code = execute([str(word) for word in words])
    return Answer(code, out.getvalue())


def function(read: Callable[[Task], object]) -> Reader:
    """Return a reader that calls a function, which may end in an error of ours."""

    def reader(task: Task) -> Answer:
        try:
            read(task)
        except StepbusError as exc:
            return Answer(2, str(exc))
        return Answer(0, "")

    return reader


def _read_all(task: Task) -> None:
    with Recording(task.path) as recording:
        for port in recording.ports.values():
            list(port.entries())
            _ = port.names, port.t, port.last_step, port.units
        recording.flaws()
        for port in recording.ports.values():
            list(port.messages())
            with contextlib.suppress(StepbusError):
                port.arrays(*dir(port)[-1:])


def _report(task: Task) -> None:
    recording = Recording(task.path)
    read_joints(recording)
    read_ports(recording, [PortCurves(table, 8) for table in readable(recording)[0]])


def _prepare_replay(task: Task) -> None:
    recording, name = Recording(task.path), task.participant
    scenario = prepare(recording, name, task.folder / "replay", [], own_program=False).scenario
    short = shorten(scenario, recording, name, 4)
    inputs_of(recording, short, name, 3)


def _prepare_rerun(task: Task) -> None:
    with Recording(task.path) as recording:
        Sources.of(recording).unpack(task.folder / "rerun")
        recording.flaws()
        recorded_calls(recording)


def _conformance(task: Task) -> None:
    recording, name = Recording(task.original), task.participant
    scenario = prepare(recording, name, task.folder / "conform", [], own_program=False).scenario
    material.read(scenario, name, task.path)


READERS: Mapping[str, Reader] = {
    "recover": lambda task: command("recover", task.path, "--out", task.folder / "whole.mcap"),
    "diff": lambda task: command("diff", task.original, task.path),
    "diff, the other first": lambda task: command("diff", task.path, task.original, "--json"),
    "read": function(_read_all),
    "report": function(_report),
    "replay, without the run": function(_prepare_replay),
    "rerun, without the run": function(_prepare_rerun),
    "conformance": function(_conformance),
}


def read_all(
    mutation: str, chance: random.Random, original: Path, folder: Path, participant: str
) -> Iterator[str]:
    """Mutate one recording in small chunks, and yield what its readers say that is wrong.

    mutation: its name. folder: to write to. participant: the one that is replayed.
    """
    before = MUTATIONS["rewritten"](chance, original.read_bytes())
    after = MUTATIONS[mutation](chance, before)
    task = Task(folder / "run.mcap", folder / "small.mcap", folder, participant)
    task.original.write_bytes(before)
    task.path.write_bytes(after)
    judge = Judge(mutation, before, after)
    for name, reader in READERS.items():
        try:
            answer = reader(task)
        except Exception:  # noqa: BLE001  (any would have been a traceback)
            answer = Answer(1, traceback.format_exc())
        yield from judge.judge(name, answer)


Ports = Mapping[str, list[tuple[int, bytes]]]
"""Topic → (step, content) of its messages."""


class Judge:
    """Judges the answers about one mutated recording, by what `mcap` reads of it.

    mutation: its name. original, data: bytes before and after it.
    """

    def __init__(self, mutation: str, original: bytes, data: bytes) -> None:
        before, after = _streamed(original), _streamed(data)
        self._is_damaged = mutation in DAMAGE and original != data
        self._is_whole = mutation == "rewritten"
        self._is_forged = mutation in FORGED and before != after
        if self._is_damaged:
            # What a damaged file has twice was left by an earlier write.
            after = {topic: list(dict.fromkeys(rows)) for topic, rows in after.items()}
        self._differs = before not in (after, _indexed(data))

    def judge(self, reader: str, answer: Answer) -> Iterator[str]:
        """Yield what is wrong with an answer."""
        said = answer.text
        is_undamaged = reader == "recover" and ": undamaged" in said
        if "Traceback" in said or "Exception ignored" in said:
            yield f"{reader}: traceback: {said.strip()[-200:]!r}"
        if answer.code < 0 or answer.code == 1:
            yield f"{reader}: exit code {answer.code}: {said.strip()[-200:]!r}"
        if reader == "recover" and self._is_whole and not is_undamaged:
            yield f"{reader}: wrong damage: {said[:200]!r}"
        if is_undamaged and (self._is_damaged or self._is_forged):
            yield f"{reader}: wrong undamaged"
        if reader.startswith("diff") and answer.code == 0 and self._differs:
            yield f"{reader}: wrong equal: {said[:100]!r}"


def _streamed(data: bytes) -> Ports:
    """Return the messages up to the first damage, without the chain."""
    return _by_port((row.topic, row.step, row.content) for row in parse(data).rows)


def _indexed(data: bytes) -> Ports:
    """Return the messages that the index leads to, where all chunks are whole.

    Damage between the chunks hides nothing from a reader that goes by the index.
    """
    try:
        reader = make_reader(io.BytesIO(data), validate_crcs=True)
        rows = reader.iter_messages(log_time_order=False)
        return _by_port((c.topic, m.sequence, m.data) for _, c, m in rows)
    except UNREADABLE:
        return {}


def _by_port(rows: Iterable[tuple[str, int, bytes]]) -> Ports:
    by_port: dict[str, list[tuple[int, bytes]]] = {}
    for topic, step, content in rows:
        if topic != CHAIN:
            by_port.setdefault(topic, []).append((step, content))
    return by_port
