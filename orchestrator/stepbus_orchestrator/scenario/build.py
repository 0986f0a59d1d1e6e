"""From a scenario's plain data to frozen types; every problem is collected."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from stepbus_orchestrator.scenario.declaration import (
    InputRow,
    ParticipantRow,
    ScenarioFile,
    is_output,
)
from stepbus_orchestrator.scenario.faults import FaultContext, parse_fault
from stepbus_orchestrator.scenario.message_types import read_types
from stepbus_orchestrator.scenario.model import (
    EXTERNAL_SPAWN_S,
    LAST_TCP_PORT,
    BusSpec,
    Deadlines,
    FaultSpec,
    HoldSpec,
    InputSpec,
    ParticipantSpec,
    Publishes,
    Scenario,
)
from stepbus_orchestrator.scenario.override import TOP_KEYS
from stepbus_participant import LONGEST_NS, Problems, whole_steps
from stepbus_participant.parameters import Keys, read
from stepbus_schemas import WiringError

_RESERVED = ("orchestrator", *TOP_KEYS)
_ON_FAULT = {"stop": None, "hold": HoldSpec()}


def build(data: Mapping[str, Any], file: Path, problems: Problems) -> Scenario:
    """Return the scenario that plain data describes.

    Values that are wrong are added to the problems and replaced by defaults.
    """
    row = read(ScenarioFile, data, problems)
    step_ns = row.step_ns or 1
    own = read_types(row.types, file.parent, problems)
    participants = tuple(
        _participant(name, item, step_ns, problems) for name, item in row.participants.items()
    )
    if data.get("participants") == {}:
        problems.add(("participants",), "is empty; a scenario needs at least one participant")
    for name, item in row.participants.items():
        own.check(name, item, data["participants"][name], problems)
    steps = _steps("duration", row.duration_ns, row.step_ns, data, problems)
    return Scenario(
        name=row.name,
        step_ns=step_ns,
        steps=steps,
        seed=row.seed,
        participants=participants,
        bus=_bus(row, problems),
        window=row.window,
        batch=_batch(row, problems),
        checkpoint_steps=_steps("checkpoint", row.checkpoint_ns, row.step_ns, data, problems) or 0,
        faults=_faults(row.faults, FaultContext(participants, steps, row.seed), problems),
        types=own.used(row.participants),
        type_files=own.files,
        folder=file.parent,
        file=file,
    )


def _steps(
    key: str, time_ns: int | None, step_ns: int, data: Mapping[str, Any], problems: Problems
) -> int | None:
    """Return how many steps a duration of the scenario is; None where it is wrong or absent."""
    if time_ns is None or not step_ns or problems.has((key,)):
        return None
    return problems.attempt((key,), partial(whole_steps, data[key], step_ns))


def _batch(row: ScenarioFile, problems: Problems) -> int:
    most = max(1, row.window // 2)
    if row.batch is not None and row.batch > most:
        text = f"must be at most half the window ({row.window}), that is {most}, not {row.batch}"
        problems.add(("batch",), text)
    return row.batch or most


def _bus(row: ScenarioFile, problems: Problems) -> BusSpec:
    bus, last = row.bus, LAST_TCP_PORT - len(row.participants)
    if bus.port is not None:
        if bus.transport == "unix" and not problems.has(("bus", "transport")):
            problems.add(("bus", "port"), "is for transport tcp; a Unix socket has none")
        elif bus.port > last:
            problems.add(("bus", "port"), f"must be at most {last}, not {bus.port}")
    if bus.transport == "tcp" and bus.low_latency:
        text = "is for transport unix; TCP never uses the low-latency transport; leave it out"
        problems.add(("bus", "low_latency"), text)
    return bus


def _faults(
    texts: tuple[str, ...], context: FaultContext, problems: Problems
) -> tuple[FaultSpec, ...]:
    faults: list[FaultSpec] = []
    for index, text in enumerate(texts):
        keys: Keys = ("faults", index)
        if problems.has(keys):
            continue
        try:
            faults += parse_fault(text, context)
        except WiringError as exc:
            problems.add(keys, str(exc))
    return tuple(faults)


def _participant(
    name: str, row: ParticipantRow, step_ns: int, problems: Problems
) -> ParticipantSpec:
    keys = ("participants", name)
    if name in _RESERVED:
        problems.add(keys, f"{name!r} means something else already; choose another name")
    most = LONGEST_NS // step_ns
    if row.every > most:
        problems.add((*keys, "every"), f"must be at most {most}, not {row.every}")
    # A misspelt `first` must not show as an algebraic loop too.
    publishes: Publishes = "first" if problems.has((*keys, "publishes")) else row.publishes
    return ParticipantSpec(
        name=name,
        participant=row.participant or "",
        exec=row.exec,
        every=row.every,
        publishes=publishes,
        inputs={port: _input(item) for port, item in row.inputs.items() if is_output(item.from_)},
        outputs=row.outputs,
        params=row.params,
        deadlines=_deadlines(row),
        on_fault=_ON_FAULT[row.on_fault] if isinstance(row.on_fault, str) else row.on_fault,
        bridge=row.bridge,
        files=row.files,
        start=row.start,
        real_time=row.real_time,
        on_late=row.on_late,
    )


def _input(row: InputRow) -> InputSpec:
    source, _, port = row.from_.partition(".")
    return InputSpec(source=source, port=port, delay=row.delay, type=row.type)


def _deadlines(row: ParticipantRow) -> Deadlines:
    default_s = EXTERNAL_SPAWN_S if row.start == "external" else Deadlines.spawn_s
    return Deadlines(
        spawn_s=default_s if row.spawn_timeout_ns is None else row.spawn_timeout_ns / 1e9,
        join_s=row.join_timeout_ns / 1e9,
        ready_s=row.ready_timeout_ns / 1e9,
        step_s=row.step_timeout_ns / 1e9,
        stop_s=row.stop_timeout_ns / 1e9,
    )
