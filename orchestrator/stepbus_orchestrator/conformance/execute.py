"""Checks one participant: the function behind `stepbus conformance`, free of printing."""

from __future__ import annotations

import contextlib
import dataclasses
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from stepbus_orchestrator.scenario import ParticipantSpec, Scenario, start_command
from stepbus_orchestrator.scenario.model import BridgeSpec
from stepbus_schemas import RAW_TYPES

from .catalogue import CHECKS
from .check import Check, run_checks
from .harness.kit import Kit
from .harness.material import find, record
from .outcome import CheckResult, Report


def conformance(
    scenario: Scenario,
    participant: str,
    program: Sequence[str] = (),
    *,
    bridge: str | None = None,
    checks: Sequence[Check] = CHECKS,
    logs: Path | None = None,
    on_result: Callable[[CheckResult], None] = lambda _result: None,
    interrupt: threading.Event | None = None,
) -> Report:
    """Play orchestrator and peers to one participant, and check what it does.

    program: its command line, started in the current folder; none: that of the scenario. bridge:
    the format that `stepbus bridge` speaks to it. logs: folder that keeps its logs, one folder for
    each start. on_result: called with each result.

    Raises WiringError when there is no such participant or program, RunFailure when its inputs
    cannot be recorded or it is interrupted.
    """
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="conformance-")))
        scenario = _prepared(scenario, participant, program, bridge)
        cwd = Path.cwd() if program else scenario.folder
        spec = scenario.participant(participant)
        words = _words(spec, program, bridge, cwd)
        material = record(scenario, participant, folder / "run")
        kit = Kit(
            material=material,
            command=words,
            cwd=cwd,
            logs=folder / "logs" if logs is None else logs,
            interrupt=interrupt or threading.Event(),
            is_scenarios=not program and bridge is None,
            knows_names=_format(spec, program, bridge) != "raw",
        )
        results = run_checks(kit, checks, on_result)
    return Report(
        scenario=scenario.name,
        participant=participant,
        program=kit.command,
        steps=material.steps,
        checks=results,
    )


def _prepared(
    scenario: Scenario, participant: str, program: Sequence[str], bridge: str | None
) -> Scenario:
    """Return the scenario without injected faults, and with the ports that the bridge carries."""
    spec = find(scenario, participant)
    outputs = spec.outputs
    if _format(spec, program, bridge) == "raw":
        # Those that nobody reads are left out, as an author of a raw program does.
        read = {(i.source, i.port) for p in scenario.participants for i in p.inputs.values()}
        outputs = {
            port: output
            for port, output in outputs.items()
            if output.type in RAW_TYPES or (participant, port) in read
        }
    specs = tuple(
        dataclasses.replace(s, on_fault=None, outputs=outputs if s is spec else s.outputs)
        for s in scenario.participants
    )
    return dataclasses.replace(scenario, participants=specs, faults=())


def _format(spec: ParticipantSpec, program: Sequence[str], bridge: str | None) -> str | None:
    """Return the format of the bridge to the program, None where there is no bridge."""
    own = None if program or spec.bridge is None else spec.bridge.format
    return own if bridge is None else bridge


def _words(
    spec: ParticipantSpec, program: Sequence[str], bridge: str | None, folder: Path
) -> tuple[str, ...]:
    """Return the command line to start."""
    own = spec.bridge if not program else None
    if bridge is not None:
        describe = {} if spec.bridge is None else spec.bridge.describe
        own = BridgeSpec(format=bridge, describe=describe)
    words = tuple(program) or spec.exec
    return start_command(dataclasses.replace(spec, exec=words, bridge=own), folder)
