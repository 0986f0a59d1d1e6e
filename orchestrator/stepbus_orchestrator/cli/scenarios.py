"""What there is before a run: `stepbus validate`, `describe` and `types`."""

import json
import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from rich.table import Table

from stepbus_orchestrator.cli import commands
from stepbus_orchestrator.cli.commands import Describe, Validate
from stepbus_orchestrator.cli.interrupts import interruptible
from stepbus_orchestrator.cli.terminal.output import Answer, table
from stepbus_orchestrator.plugins import ABOUT, named_points, view
from stepbus_orchestrator.processes.slots import slot_counts
from stepbus_orchestrator.run.describe import JointRow, OutputPort, ParticipantDescription, describe
from stepbus_orchestrator.run.rehearse import rehearse
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.model import Scenario
from stepbus_orchestrator.scenario.schedule import Schedule
from stepbus_participant import load_types
from stepbus_participant.parameters import is_file_name, read_yaml
from stepbus_schemas import (
    MESSAGE_TYPES,
    Description,
    Types,
    json_schema,
    types_page,
    types_vectors,
)

_NUMERIC = ("index", "lower", "upper", "velocity", "effort")
_UNLIMITED = "-"


def validate_command(given: Validate) -> Answer:
    """Return the schedule of a scenario; raises ScenarioError with all problems."""
    warnings: list[str] = []
    loaded = load(given.scenario, given.set, last_check=partial(rehearse, warnings=warnings))
    schedule = Schedule(loaded)
    shown = schedule.text(given.steps)
    is_cut = loaded.steps is None or given.steps < loaded.steps
    slots = slot_counts(loaded)
    length = "no fixed end" if loaded.steps is None else f"{loaded.steps} steps"
    return Answer(
        value={
            "name": loaded.name,
            "file": str(loaded.file),
            "step_ns": loaded.step_ns,
            "steps": loaded.steps,
            "order": schedule.order,
            "schedule": shown.split(),
            "slots": slots,
            "warnings": warnings,
        },
        lines=[
            *(f"warning: {text}" for text in warnings),
            f"{loaded.file}: valid; {length} of {loaded.step_ns * 1e-6:g} ms",
            shown + (" …" if is_cut else ""),
            *(
                (
                    f"bulk {output}: {count} slots in shared memory, each sized for its "
                    "largest message"
                )
                for output, count in slots.items()
            ),
        ],
    )


def describe_command(given: Describe) -> Answer:
    """Return what the participants say of their ports."""
    loaded = load(given.scenario, given.set)
    with interruptible() as interrupt:
        described = describe(loaded, interrupt)
    if given.graph is not None:
        said = {
            one.participant: {output.port: output.description for output in one.outputs}
            for one in described
        }
        return Answer(value=described, lines=[view("wiring")(loaded, said, *given.graph)])
    return Answer(value=described, lines=_described(loaded, described))


def _described(
    scenario: Scenario, described: list[ParticipantDescription]
) -> Iterator[str | Table]:
    about = named_points(ABOUT)
    for participant in described:
        yield participant.participant
        spec = scenario.participant(participant.participant)
        if spec.participant in about:
            yield from about[spec.participant].load()(spec, scenario)
        for item in participant.inputs:
            delay = f", {item.delay} steps old" if item.delay else ""
            yield f"  input   {item.port}: {item.type} from {item.source}{delay}"
        for output in participant.outputs:
            yield _headline(output)
            if rows := _rows(output):
                yield _table(rows)


def _headline(output: OutputPort) -> str:
    description = output.description
    facts = [f"read by {', '.join(output.taken_by) or 'no participant'}"]
    if description.shape:
        facts.append(f"shape {' × '.join(map(str, description.shape))}")
    facts += [f"{field} in {unit}" for field, unit in description.units.items()]
    return f"  output  {output.port}: {output.type}, {'; '.join(facts)}"


def _rows(output: OutputPort) -> list[dict[str, Any]]:
    """Return column → value of each joint, or of each name, without empty columns."""
    if output.joints:
        rows = [msgspec.structs.asdict(joint) for joint in output.joints]
        columns = [
            c for c in JointRow.__struct_fields__ if any(row[c] not in ("", None) for row in rows)
        ]
        return [{column: row[column] for column in columns} for row in rows]
    description: Description = output.description
    more: dict[str, Sequence[Any]] = {**description.details, **description.limits}
    return [
        {"index": index, "name": name, **{key: values[index] for key, values in more.items()}}
        for index, name in enumerate(description.names)
    ]


def _table(rows: list[dict[str, Any]]) -> Table:
    made = table(*rows[0], right=_NUMERIC)
    for row in rows:
        made.add_row(*map(_cell, row.values()))
    return made


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:.5g}" if math.isfinite(value) else _UNLIMITED
    return "" if value is None else str(value)


def types_command(given: commands.Types) -> Answer:
    """Return the schemas of message types, and write them where a folder is given."""
    types = _types(given.source) if given.source else Types()
    names = list(types.declarations) or ([] if given.source else [*MESSAGE_TYPES])
    schemas = {name: json_schema(name, types) for name in names}
    page = types_page(names, types)
    if given.out is None:
        return Answer(value=schemas, lines=[page.rstrip() if names else "no types of its own"])
    files = {"messages.md": page, "vectors.json": types_vectors(types)} | {
        f"json/{name.replace('/', '.')}.json": json.dumps(s, ensure_ascii=False, indent=2) + "\n"
        for name, s in schemas.items()
    }
    return Answer(value=schemas, lines=_written(given.out, files))


def _written(folder: Path, files: dict[str, str]) -> Iterator[str]:
    """Write files, and yield the path of each."""
    for path, text in files.items():
        file = folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8", newline="\n")
        yield str(file)


def _types(source: str) -> Types:
    """Return the types of a scenario, a file or a module; raises WiringError."""
    path = Path(source)
    if is_file_name(source) and path.is_file():
        data = read_yaml(path, "a file of message types needs the key 'types'").data
        if "participants" not in data and "extends" not in data:
            return load_types(path)
    elif "." in source and not path.exists():
        return load_types(source)
    return load(path).types
