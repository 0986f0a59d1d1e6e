"""What the participants of a scenario say of their ports, before any step."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Mapping
from pathlib import Path

import msgspec

from stepbus_schemas import Description

from .errors import RunFailure
from .reader import Recording
from .run import Options, run
from .scenario import Scenario


class PortDescription(msgspec.Struct, frozen=True, kw_only=True):
    """One output: its type, who takes it, and what its participant says of it."""

    participant: str
    port: str
    type: str
    taken_by: list[str]
    description: Description


class DescribeFailed(RunFailure):
    """The participants did not get as far as describing themselves."""


def describe(scenario: Scenario) -> list[PortDescription]:
    """Return a description of every output, in schedule order.

    It is a run of no steps: every participant is started, loads its model, describes its outputs
    and is ended; what it has recorded is read and removed.

    Raises DescribeFailed, with the exit code of the run, when that fails.
    """
    with tempfile.TemporaryDirectory(prefix="describe-") as folder:
        result = run(dataclasses.replace(scenario, steps=0), Options(out=Path(folder) / "run"))
        if result.exit_code:
            raise _failure(result.exit_code, result.reason)
        recording = Recording.open(result.recording)
    taken = _taken_by(scenario)
    return [
        PortDescription(
            participant=port.participant,
            port=port.name,
            type=port.type,
            taken_by=taken.get((port.participant, port.name), []),
            description=port.description,
        )
        for port in recording.ports.values()
        if port.participant in {spec.name for spec in scenario.participants}
    ]


def _failure(code: int, reason: str) -> DescribeFailed:
    failure = DescribeFailed(reason)
    failure.code = type(failure.code)(code)
    return failure


def _taken_by(scenario: Scenario) -> Mapping[tuple[str, str], list[str]]:
    """Return who takes each output: (participant, port) → `participant.input`."""
    taken: dict[tuple[str, str], list[str]] = {}
    for spec in scenario.participants:
        for name, source in spec.inputs.items():
            taken.setdefault((source.source, source.port), []).append(f"{spec.name}.{name}")
    return taken
