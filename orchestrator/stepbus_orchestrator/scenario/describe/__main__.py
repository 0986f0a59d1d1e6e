"""Write what follows from declared parameters: `python -m stepbus_orchestrator.scenario.describe`.

That is `schemas/json/scenario.schema.json` and `world.schema.json`, and in the pages of `docs/`
the tables between markers such as `<!-- parameters: stepbus_plant.params:Params -->`. With
`--check` nothing is written; the exit code is 1 when a file is out of date.
"""

import argparse
import importlib
import importlib.util
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from stepbus_orchestrator.scenario.reading.declaration import ParticipantRow, ScenarioFile
from stepbus_participant import Settings

from .schema import SchemaWriter
from .tables import table, tables

CHECKOUT = Path(__file__).resolve().parents[4]
_BLOCK = re.compile(
    r"(<!-- parameters: ([\w.]+):(\w+)( only)? -->\n).*?(<!-- /parameters -->)", re.DOTALL
)
_WORLD = "stepbus_plant.world.declaration:WorldFile"
SERVICES = (
    "stepbus_plant",
    "stepbus_controller",
    "stepbus_controller.position",
    "stepbus_motion.arm",
    "stepbus_motion.mobile",
    "stepbus_mission",
    "stepbus_mission.goals",
    "stepbus_mission.round_trip",
    "stepbus_mission.store",
    "stepbus_perception",
    "stepbus_planner",
    "stepbus_world_model",
)
"""What `python -m` runs; their `params` are in the schema of a scenario."""


def generated_files(root: Path) -> dict[Path, str]:
    """Return path → content of every generated file."""
    folder = root / "schemas/json"
    world = SchemaWriter().document(_class(_WORLD), "A world of stepbus")
    files = {
        folder / "scenario.schema.json": _indented(scenario_schema()),
        folder / "world.schema.json": _indented(world),
    }
    for page in sorted((root / "docs").rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        if _BLOCK.search(text):
            files[page] = _BLOCK.sub(_block, text)
    return files


def scenario_schema() -> dict[str, Any]:
    """Return the schema of a scenario, with the parameters of what ships with stepbus."""
    writer = SchemaWriter(partial=True)
    schema = writer.document(ScenarioFile, "A scenario of stepbus")
    row = writer.definitions[writer.reference(ParticipantRow)["$ref"].rpartition("/")[2]]
    row["allOf"] = [
        {
            "if": {"properties": {"exec": {"const": ["python", "-m", name]}}, "required": ["exec"]},
            "then": {"properties": {"params": writer.reference(_params(name))}},
        }
        for name in SERVICES
    ]
    return schema


def _params(service: str) -> type[Settings]:
    own = importlib.util.find_spec(f"{service}.params")
    return _class(f"{service}.params:Params" if own else f"{service}:Params")


def _class(name: str) -> type[Settings]:
    module, _, attribute = name.partition(":")
    found: type[Settings] = getattr(importlib.import_module(module), attribute)
    return found


def _block(found: re.Match[str]) -> str:
    settings = _class(f"{found[2]}:{found[3]}")
    return f"{found[1]}{(table if found[4] else tables)(settings)}{found[5]}"


def _indented(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, indent=2) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check the files of the checkout this module lies in; return the exit code."""
    name = "python -m stepbus_orchestrator.scenario.describe"
    parser = argparse.ArgumentParser(prog=name, description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, exit 1 when stale")
    check = parser.parse_args(arguments).check
    if not (CHECKOUT / "pyproject.toml").is_file():
        parser.error(f"{CHECKOUT} is no checkout of stepbus; run this from one")
    stale = False
    for path, text in generated_files(CHECKOUT).items():
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            continue
        stale = True
        if not check:
            path.write_text(text, encoding="utf-8", newline="\n")
        verb = f"out of date, run `{name}`" if check else "written"
        sys.stdout.write(f"{path.relative_to(CHECKOUT)}: {verb}\n")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
