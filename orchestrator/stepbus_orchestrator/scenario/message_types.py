"""The message types that a scenario brings, and which types its ports have."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from stepbus_orchestrator.scenario.declaration import ParticipantRow
from stepbus_orchestrator.scenario.model import HoldSpec
from stepbus_participant import Problems, find_file, suggest
from stepbus_participant.parameters import (
    Keys,
    declarations_in,
    is_file_name,
    module_types,
    read_types_file,
)
from stepbus_schemas import Types, WiringError, explained

Given = str | Mapping[str, Any] | tuple[str | Mapping[str, Any], ...]
_KEY = "types"


@dataclass(frozen=True, kw_only=True)
class OwnTypes:
    """The types that a scenario brings.

    files: of the scenario → the types that each declares. is_complete: whether all of them could be
    read; if not, a type that is unknown may be one of the others.
    """

    types: Types
    files: Mapping[str, tuple[str, ...]]
    is_complete: bool

    def used(self, rows: Mapping[str, ParticipantRow]) -> Types:
        """Return those that ports have."""
        names = [output.type for row in rows.values() for output in row.outputs.values()]
        return self.types.only(names)

    def check(self, name: str, row: ParticipantRow, data: Any, problems: Problems) -> None:
        """Add what is wrong with the types of a participant's ports, and with safe messages.

        data: the participant as it stands in the scenario.
        """
        keys = ("participants", name)
        for port, output in row.outputs.items():
            below: Keys = () if isinstance(data["outputs"][port], str) else ("type",)
            self._check_type((*keys, "outputs", port, *below), output.type, problems)
        for port, item in row.inputs.items():
            if item.type is not None:
                self._check_type((*keys, "inputs", port, "type"), item.type, problems)
        if isinstance(row.on_fault, HoldSpec):
            for below, text in self._safe_problems(row, row.on_fault.safe):
                problems.add((*keys, "on_fault", "safe", *below), text)

    def _check_type(self, keys: Keys, name: str, problems: Problems) -> None:
        if not name or problems.has(keys) or (name not in self.types and not self.is_complete):
            return
        try:
            self.types[name]
        except WiringError as exc:
            problems.add(keys, str(exc))

    def _safe_problems(
        self, row: ParticipantRow, safe: Mapping[str, Any]
    ) -> Iterator[tuple[Keys, str]]:
        for port, message in safe.items():
            if port not in row.outputs:
                yield (port,), f"no output {port!r}{suggest(port, row.outputs)}"
                continue
            name = row.outputs[port].type
            if name in self.types:
                fields = self.types[name].__struct_fields__
                for field in (field for field in message if field not in fields):
                    yield (port, field), f"{name} has no field {field!r}{suggest(field, fields)}"
                try:
                    msgspec.convert(message, self.types[name])
                except msgspec.ValidationError as exc:
                    yield (port,), f"is no {name}: {explained(exc, self.types[name])}"


def read_types(given: Given, folder: Path, problems: Problems) -> OwnTypes:
    """Return the types of a scenario; what is wrong is added to the problems.

    given: the value of `types`. folder: of the scenario.
    """
    before = len(problems)
    sources = given if isinstance(given, tuple) else (given,)
    types: dict[str, Mapping[str, Any]] = {}
    files: dict[str, tuple[str, ...]] = {}
    for index, source in enumerate(sources):
        keys: Keys = (_KEY, index) if isinstance(given, tuple) else (_KEY,)
        if not problems.has(keys):
            rows = _read(source, folder, keys, problems)
            for name in (name for name in rows if name in types):
                problems.add(keys, f"{name} is declared twice; leave one of the two out")
            types |= rows
            if isinstance(source, str) and is_file_name(source) and "://" not in source:
                files[source] = tuple(rows)
    return OwnTypes(
        types=Types(types),
        files=files,
        is_complete=len(problems) == before,
    )


def _read(
    source: str | Mapping[str, Any], folder: Path, keys: Keys, problems: Problems
) -> dict[str, Mapping[str, Any]]:
    if isinstance(source, Mapping):
        declared, wrong = declarations_in(source)
        for below, text in wrong:
            problems.add((*keys, *below), text)
        return declared
    if is_file_name(source):
        path = problems.attempt(keys, partial(find_file, source, folder))
        if path is None:
            return {}
        return problems.attempt(keys, partial(read_types_file, path)) or {}
    declared, wrong = module_types(source)
    for _, text in wrong:
        problems.add(keys, text)
    return declared
