"""Participants that somebody else starts: what a run refuses of them."""

import dataclasses
from collections.abc import Iterable

from stepbus_orchestrator.errors import argument
from stepbus_orchestrator.scenario import (
    EXTERNAL_SPAWN_S,
    PROCESS_FAULTS,
    Scenario,
    faults_of,
    format_fault,
)
from stepbus_participant import suggest
from stepbus_schemas import WiringError

from .options import Options


def external_names(scenario: Scenario) -> list[str]:
    """Return who is started by somebody else."""
    return [spec.name for spec in scenario.participants if spec.is_external]


def as_children(scenario: Scenario) -> Scenario:
    """Return a scenario in which the orchestrator starts everybody."""
    specs = (
        dataclasses.replace(spec, start="child") if spec.is_external else spec
        for spec in scenario.participants
    )
    return dataclasses.replace(scenario, participants=tuple(specs))


def as_external(scenario: Scenario, names: Iterable[str]) -> Scenario:
    """Return a scenario in which somebody else starts some participants, and they have time.

    Raises WiringError for a name that no participant has.
    """
    known = [spec.name for spec in scenario.participants]
    changed = {}
    for name in names:
        if name not in known:
            raise WiringError(f"no participant {name!r}{suggest(name, known)}")
        spec = scenario.participant(name)
        spawn_s = max(spec.deadlines.spawn_s, EXTERNAL_SPAWN_S)
        deadlines = dataclasses.replace(spec.deadlines, spawn_s=spawn_s)
        changed[name] = dataclasses.replace(spec, start="external", deadlines=deadlines)
    specs = tuple(changed.get(spec.name, spec) for spec in scenario.participants)
    return dataclasses.replace(scenario, participants=specs)


def check_external(scenario: Scenario, options: Options) -> None:
    """Raise WiringError for what cannot be done to a participant that somebody else starts."""
    names = external_names(scenario)
    for name in options.tickets:
        if name not in names:
            raise WiringError(f"no external participant {name!r}{suggest(name, names)}")
    if not names:
        return
    if options.in_process:
        raise WiringError(
            f"{', '.join(names)}: a participant that somebody else starts has a process of its "
            f"own; leave out {argument('--in-process')}"
        )
    for name in options.debug:
        if name in names:
            raise WiringError(
                f"{name}: --debug gives a terminal to a participant that is started here; start "
                f"this one in a debugger yourself, and give it --no-deadline {name}"
            )
    faults = [
        format_fault(fault)
        for fault in faults_of(scenario.faults, PROCESS_FAULTS)
        if fault.participant in names
    ]
    if faults:
        raise WiringError(
            f"{', '.join(faults)}: stepbus sends no signal to a process that it has not started; "
            "faults on messages work for an external participant too"
        )
