"""From a path, a name or plain data to a checked scenario; every problem is collected."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from msgspec import structs

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.scenario.check import check
from stepbus_orchestrator.scenario.extend import read_extended
from stepbus_orchestrator.scenario.fault_texts import add_faults, parse_fault
from stepbus_orchestrator.scenario.foreign import with_participants
from stepbus_orchestrator.scenario.locate import locate
from stepbus_orchestrator.scenario.model import (
    FaultSpec,
    ParticipantRow,
    ParticipantSpec,
    Scenario,
    ScenarioFile,
    message_problems,
)
from stepbus_orchestrator.scenario.override import TOP_KEYS, override
from stepbus_orchestrator.scenario.scenario_files import find_files
from stepbus_participant import Problems, SettingsError, suggest, whole_steps
from stepbus_participant.parameters import Keys, YamlFile, is_file_name, read, read_types
from stepbus_schemas import Types

_RESERVED = ("orchestrator", *TOP_KEYS)


def load(
    scenario: str | Path | Mapping[str, Any],
    overrides: Sequence[str] = (),
    faults: Sequence[str] = (),
    *,
    folder: Path | None = None,
    last_check: Callable[[Scenario, Problems], None] | None = None,
) -> Scenario:
    """Load and check a scenario; nothing is started.

    scenario: a YAML file, a folder with a scenario.yaml, the name of a built-in scenario, or plain
    data, as YAML would have it. overrides: settings such as `controller.params.kp=80` or
    `duration=2s`; files in them are absolute, or relative to the scenario's folder. faults: more
    of them, such as `kill plant at 120`. folder: what relative file names in plain data are
    relative to; default: the current one. last_check: comes after all others, where these find
    nothing.

    Raises ScenarioError that lists every problem with file, line and path.
    """
    try:
        if isinstance(scenario, Mapping):
            path = (folder or Path.cwd()).absolute() / "scenario"
            document = YamlFile(file="scenario", data=dict(scenario), places={})
        else:
            path = locate(scenario)
            document = read_extended(path)
        document, named = override(document, overrides, path.parent)
        document = with_participants(document, path.parent)
        if faults:
            document = add_faults(document, faults)
        problems = document.problems()
        checked = _build(document.data, path, problems)
        check(checked, problems)
        files = find_files(checked)
        for keys, message in files.problems:
            problems.add(keys, message)
        problems.refuse()
        if last_check is not None:
            last_check(checked, problems)
            problems.refuse()
    except SettingsError as exc:
        raise ScenarioError(exc.problems) from exc
    return dataclasses.replace(checked, overrides=named, files=files.paths, left_out=files.left_out)


def _build(data: Mapping[str, Any], file: Path, problems: Problems) -> Scenario:
    """Return the scenario that plain data describes.

    Every mistake is added to the problems, and a default stands in its place.
    """
    row = read(ScenarioFile, data, problems)
    types, type_files = _own_types(row.types, file.parent, problems)
    specs = [_participant(name, item, problems) for name, item in row.participants.items()]
    if data.get("participants") == {}:
        problems.add(("participants",), "is empty; a scenario needs at least one participant")
    for spec in specs:
        _check_types(spec, data["participants"][spec.name], types, problems)
    most = max(1, row.window // 2)
    if row.batch is not None and row.batch > most:
        text = f"must be at most half the window ({row.window}), that is {most}, not {row.batch}"
        problems.add(("batch",), text)
    scenario = Scenario(
        name=row.name,
        step_ns=row.step_ns or 1,
        steps=_steps("duration", row.duration_ns, row.step_ns, data, problems),
        seed=row.seed,
        participants=tuple(specs),
        bus=row.bus,
        window=row.window,
        batch=row.batch or most,
        checkpoint_steps=_steps("checkpoint", row.checkpoint_ns, row.step_ns, data, problems) or 0,
        types=types.only([output.type for spec in specs for output in spec.outputs.values()]),
        type_files=type_files,
        folder=file.parent,
        file=file,
    )
    return dataclasses.replace(scenario, faults=_faults(row.faults, scenario, problems))


def _steps(
    key: str, time_ns: int | None, step_ns: int, data: Mapping[str, Any], problems: Problems
) -> int | None:
    """Return how many steps a duration of the scenario is; None where it is wrong or absent."""
    if time_ns is None or not step_ns or problems.has((key,)):
        return None
    return problems.attempt((key,), partial(whole_steps, data[key], step_ns))


def _faults(
    texts: tuple[str, ...], scenario: Scenario, problems: Problems
) -> tuple[FaultSpec, ...]:
    faults: list[FaultSpec] = []
    for index, text in enumerate(texts):
        keys: Keys = ("faults", index)
        if not problems.has(keys):
            faults += problems.attempt(keys, partial(parse_fault, text, scenario)) or ()
    return tuple(faults)


def _participant(name: str, row: ParticipantRow, problems: Problems) -> ParticipantSpec:
    keys = ("participants", name)
    if name in _RESERVED:
        problems.add(keys, f"{name!r} is a reserved name; choose another")
    changed: dict[str, Any] = {
        "inputs": {
            p: item for p, item in row.inputs.items() if not problems.has((*keys, "inputs", p))
        },
        "on_fault": row.hold or "stop",
    }
    if problems.has((*keys, "publishes")):
        # A misspelt `first` must not show as an algebraic loop too.
        changed["publishes"] = "first"
    return ParticipantSpec(name=name, **structs.asdict(row) | changed)


def _own_types(
    given: str | Mapping[str, Any] | tuple[str | Mapping[str, Any], ...],
    folder: Path,
    problems: Problems,
) -> tuple[Types, Mapping[str, tuple[str, ...]]]:
    """Return the types of a scenario, and file of the scenario → the types that it declares.

    given: the value of `types`; what is wrong with it is added to the problems. folder: of the
    scenario.
    """
    types: dict[str, Mapping[str, Any]] = {}
    files: dict[str, tuple[str, ...]] = {}
    for index, source in enumerate(given if isinstance(given, tuple) else (given,)):
        keys: Keys = ("types", index) if isinstance(given, tuple) else ("types",)
        if not problems.has(keys):
            declared = read_types(source, problems, keys, folder)
            for name in (name for name in declared if name in types):
                problems.add(keys, f"{name} is declared twice; remove one of the two")
            types |= declared
            if isinstance(source, str) and is_file_name(source) and "://" not in source:
                files[source] = tuple(declared)
    return Types(types), files


def _check_types(spec: ParticipantSpec, data: Any, types: Types, problems: Problems) -> None:
    """Add what is wrong with the types of a participant's ports, and with safe messages.

    data: the participant as it stands in the scenario.
    """
    keys = ("participants", spec.name)
    ports: dict[Keys, str] = {}
    for port, output in spec.outputs.items():
        below: Keys = () if isinstance(data["outputs"][port], str) else ("type",)
        ports["outputs", port, *below] = output.type
    for port, item in spec.inputs.items():
        ports["inputs", port, "type"] = item.type or ""
    for at, name in ports.items():
        # A type that is unknown may be one of those that could not be read.
        is_known = name in types or not problems.has(("types",))
        if name and is_known and not problems.has((*keys, *at)):
            problems.attempt((*keys, *at), partial(types.__getitem__, name))
    if spec.hold is not None:
        for at, text in _safe_problems(spec, spec.hold.safe, types):
            problems.add((*keys, "on_fault", "safe", *at), text)


def _safe_problems(
    spec: ParticipantSpec, safe: Mapping[str, Any], types: Types
) -> Iterator[tuple[Keys, str]]:
    for port, message in safe.items():
        if port not in spec.outputs:
            yield (port,), f"no output {port!r}{suggest(port, spec.outputs)}"
            continue
        name = spec.outputs[port].type
        if name in types:
            for at, text in message_problems(message, types[name], name):
                yield (port, *at), text
