"""Write what follows from declared parameters: `python -m scripts.generate_parameters`.

That is `schemas/json/scenario.schema.json` and `world.schema.json`, and in the pages of `docs/`
the tables between markers such as `<!-- parameters: stepbus_plant.params:Params -->`. A package
of this checkout with participants of its own has all that but the world in its own folder; where it
is not installed, that is left alone. With `--check` nothing is written; the exit code is 1 when a
file is out of date.
"""

import importlib
import importlib.util
import re
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from stepbus_orchestrator.scenario.model import ParticipantRow, ScenarioFile
from stepbus_orchestrator.scenario.program import participant_classes
from stepbus_participant import Settings, declared_parameters

from .generate_messages import CHECKOUT, bring_up_to_date, indented
from .parameter_docs import SchemaWriter, tables

_BLOCK = re.compile(
    r"(<!-- parameters: ([\w.]+):(\w+)( only)? -->\n).*?(<!-- /parameters -->)", re.DOTALL
)
_WORLD = "stepbus_plant.world:WorldFile"


def generated_files(root: Path) -> dict[Path, str | None]:
    """Return path → content of every generated file."""
    world = SchemaWriter().document(_class(_WORLD), "A world of stepbus")
    files: dict[Path, str | None] = {root / "schemas/json/world.schema.json": indented(world)}
    own = {name: _project(name) for name in participant_classes()}
    for project in sorted({Path(), *filter(None, own.values())}):
        services = [name for name, at in own.items() if at in (Path(), project)]
        schema = root / project / "schemas/json/scenario.schema.json"
        files[schema] = indented(scenario_schema(services))
        for page in sorted((root / project / "docs").rglob("*.md")):
            text = page.read_text(encoding="utf-8")
            if _BLOCK.search(text):
                files[page] = _BLOCK.sub(_block, text)
    return files


def _project(module: str) -> Path | None:
    """Return the folder of the checkout whose pyproject.toml packs a module; None: elsewhere."""
    spec = importlib.util.find_spec(re.split("[.:]", module)[0])
    above = Path(spec.origin).resolve().parents if spec is not None and spec.origin else ()
    projects = (folder for folder in above if (folder / "pyproject.toml").is_file())
    project = next(projects, None)
    if project is None or not project.is_relative_to(CHECKOUT):
        return None
    return project.relative_to(CHECKOUT)


def scenario_schema(services: Iterable[str]) -> dict[str, Any]:
    """Return the schema of a scenario, with the parameters that services declare."""
    writer = SchemaWriter(partial=True)
    schema = writer.document(ScenarioFile, "A scenario of stepbus")
    row = writer.definitions[writer.reference(ParticipantRow)["$ref"].rpartition("/")[2]]
    row["properties"]["participant"]["examples"] = sorted(services)
    row["allOf"] = [
        {
            "if": {"properties": {"participant": {"const": name}}, "required": ["participant"]},
            "then": {"properties": {"params": writer.reference(params)}},
        }
        for name in services
        if (params := declared_parameters(name.rpartition(":")[0], Path())) is not None
    ]
    return schema


def _class(name: str) -> type[Settings]:
    module, _, attribute = name.partition(":")
    cls: type[Settings] = getattr(importlib.import_module(module), attribute)
    return cls


def _block(match: re.Match[str]) -> str:
    settings = _class(f"{match[2]}:{match[3]}")
    return f"{match[1]}{tables(settings, only=bool(match[4]))}{match[5]}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check the files of this checkout; return the exit code."""
    command = "python -m scripts.generate_parameters"
    return bring_up_to_date(arguments, command, partial(generated_files, CHECKOUT))


if __name__ == "__main__":
    sys.exit(main())
