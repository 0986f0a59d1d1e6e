"""Every command and function that reads a recording, called on one that may be anything.

The commands are called in this process, as `stepbus` calls them; each returns what it printed.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

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


def _read_arrays(task: Task) -> None:
    recording = Recording(task.path)
    for port in recording.ports.values():
        with contextlib.suppress(StepbusError):
            port.arrays(*dir(port)[-1:])
    for port in recording.of_type("JointState/1"):
        port.arrays("position", "velocity", "effort")


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


def _recover(task: Task) -> Answer:
    return command("recover", task.path, "--out", task.folder / "whole.mcap")


def _diff(task: Task) -> Answer:
    return command("diff", task.original, task.path)


def _diff_reversed(task: Task) -> Answer:
    return command("diff", task.path, task.original, "--json")


READERS: Mapping[str, Reader] = {
    "recover": _recover,
    "diff": _diff,
    "diff, the other first": _diff_reversed,
    "read": function(_read_all),
    "arrays": function(_read_arrays),
    "report": function(_report),
    "replay, without the run": function(_prepare_replay),
    "rerun, without the run": function(_prepare_rerun),
    "conformance": function(_conformance),
}
