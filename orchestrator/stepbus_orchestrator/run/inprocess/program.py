"""What a participant of a run in one process executes, in the place of its process."""

import importlib
from collections.abc import Callable
from pathlib import Path

from stepbus_orchestrator.errors import argument
from stepbus_orchestrator.run.extensions.hosted_caller import Seat
from stepbus_orchestrator.scenario import ParticipantSpec, Scenario, start_command
from stepbus_participant import import_participant, main
from stepbus_schemas import WiringError

_BRIDGE = ("stepbus", "bridge")


def check_programs(scenario: Scenario) -> None:
    """Raise WiringError, with all of them, for participants that need a process of their own."""
    problems = [
        f"participants.{spec.name}: `{' '.join(spec.exec)}` is a program of its own; "
        f"{_remedy(spec)}leave out {argument('--in-process')}"
        for spec in scenario.participants
        if not (spec.participant or _is_bridged(spec))
    ]
    if problems:
        raise WiringError("\n".join(problems))


def _is_bridged(spec: ParticipantSpec) -> bool:
    return spec.bridge is not None or spec.exec[:2] == _BRIDGE


def _remedy(spec: ParticipantSpec) -> str:
    """Return what to write instead of a program in Python."""
    if spec.exec[:1] != ("python",):
        return ""
    files = [word for word in spec.exec if word.endswith(".py")]
    name = f"{files[0]}:CLASS" if files else "MODULE:CLASS"
    return f"write `participant: {name}` instead of `exec`, with the name of its class, or "


def program_of(spec: ParticipantSpec, folder: Path, seat: Seat | None) -> Callable[[], int]:
    """Return what takes part and returns the exit code; the class is imported when it is called."""
    if seat is not None and seat.name == spec.name:
        return lambda: main(seat.make)
    if not spec.participant:
        return lambda: _bridge(spec, folder)
    return lambda: _take_part(spec.participant, folder)


def _take_part(name: str, folder: Path) -> int:
    try:
        factory = import_participant(name, folder)
    except WiringError as exc:
        raise SystemExit(str(exc)) from None
    return main(factory)


def _bridge(spec: ParticipantSpec, folder: Path) -> int:
    command = start_command(spec, folder)
    arguments = command[command.index("stepbus_bridge") + 1 :]
    return main(importlib.import_module("stepbus_bridge").bridge_to(arguments))
