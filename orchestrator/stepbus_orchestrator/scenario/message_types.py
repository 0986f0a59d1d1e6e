"""The message types that a scenario brings, and which types its ports have."""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.scenario.model import ParticipantSpec
from stepbus_participant import Problems, suggest
from stepbus_participant.parameters import Keys, is_file_name, read_types
from stepbus_schemas import Types, explained

_KEY = "types"


def own_types(
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
        keys: Keys = (_KEY, index) if isinstance(given, tuple) else (_KEY,)
        if not problems.has(keys):
            declared = read_types(source, problems, keys, folder)
            for name in (name for name in declared if name in types):
                problems.add(keys, f"{name} is declared twice; remove one of the two")
            types |= declared
            if isinstance(source, str) and is_file_name(source) and "://" not in source:
                files[source] = tuple(declared)
    return Types(types), files


def check_types(spec: ParticipantSpec, data: Any, types: Types, problems: Problems) -> None:
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
        is_known = name in types or not problems.has((_KEY,))
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
            fields = types[name].__struct_fields__
            for field in (field for field in message if field not in fields):
                yield (port, field), f"{name} has no field {field!r}{suggest(field, fields)}"
            try:
                msgspec.convert(message, types[name])
            except msgspec.ValidationError as exc:
                yield (port,), f"is not a valid {name}: {explained(exc, types[name])}"
