"""`stepbus types`: message types as a table, JSON Schema, byte vectors and layout in numbers."""

import argparse
import json
from pathlib import Path

from stepbus_orchestrator.cli.command import Command
from stepbus_orchestrator.cli.output import say, say_json
from stepbus_orchestrator.scenario import load
from stepbus_participant import load_types
from stepbus_participant.parameters import is_file_name, read_yaml
from stepbus_schemas import MESSAGE_TYPES, Types, json_schema, types_page, types_vectors


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        nargs="?",
        help="a scenario with types of its own, a YAML file of types, or an installed module of "
        "message classes (default: the types that ship)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FOLDER",
        help="write messages.md, vectors.json and a JSON Schema for each type",
    )
    parser.add_argument("--json", action="store_true", help="print the JSON Schemas by type")


def _execute(args: argparse.Namespace) -> int:
    types = Types() if args.source is None else _types(args.source)
    names = list(types.declarations) or ([*MESSAGE_TYPES] if args.source is None else [])
    if args.json:
        say_json({name: json_schema(name, types) for name in names})
        return 0
    if args.out is None:
        say(types_page(names, types).rstrip() if names else "no types of its own")
        return 0
    files = {"messages.md": types_page(names, types), "vectors.json": types_vectors(types)}
    for name in names:
        schema = json.dumps(json_schema(name, types), ensure_ascii=False, indent=2)
        files[f"json/{name.replace('/', '.')}.json"] = f"{schema}\n"
    for path, text in files.items():
        file = args.out / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8", newline="\n")
        say(str(file))
    return 0


def _types(source: str) -> Types:
    """Return the types of a scenario, a file or a module; raises WiringError."""
    path = Path(source)
    if is_file_name(source) and path.is_file():
        data = read_yaml(path, "a file of message types has the key 'types'").data
        if "participants" not in data and "extends" not in data:
            return load_types(path)
    elif "." in source and not path.exists():
        return load_types(source)
    return load(source).types


COMMAND = Command(
    name="types",
    summary="show message types, or write their schemas and byte vectors",
    description="Shows the fields of message types with units and shapes, and their layout in "
    "format raw of the bridge. With --out, writes what a program in another language is tested "
    "with: JSON Schemas, and byte vectors that its codec has to read, write and refuse.",
    examples=("stepbus types", "stepbus types types.yaml --out types"),
    add_arguments=_add_arguments,
    execute=_execute,
)
