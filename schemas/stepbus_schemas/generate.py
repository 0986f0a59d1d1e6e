"""Write what follows from the message types: `python -m stepbus_schemas.generate [--check]`.

That is the JSON Schemas, the byte vectors and `docs/reference/messages.md`. With `--check`, it
writes nothing and exits with 1 when a file is out of date. Where a vector that was published under
the present protocol number has changed its meaning, it exits with 1 and writes nothing.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from stepbus_schemas.messages import MESSAGE_TYPES
from stepbus_schemas.published import Published, broken, published
from stepbus_schemas.schema import json_schema
from stepbus_schemas.tables import messages_page
from stepbus_schemas.vectors import from_notation, line_by_line, vectors

from .protocol import ENVELOPE_TYPES, PROTOCOL_VERSION

CHECKOUT = Path(__file__).resolve().parents[2]
"""Where this file lies in a checkout of the repository."""

SCHEMAS_FOLDER = "schemas/json"
VECTORS_FILE = "schemas/vectors.json"
PUBLISHED_FILE = f"schemas/published/{PROTOCOL_VERSION}.json"
_VECTORS = CHECKOUT / VECTORS_FILE


def generated_files(root: Path) -> dict[Path, str]:
    """Return path → content of every generated file."""
    files = {
        root / SCHEMAS_FOLDER / f"{name.replace('/', '.')}.json": _indented(json_schema(name))
        for name in (*MESSAGE_TYPES, *ENVELOPE_TYPES)
    }
    known = json.loads(_VECTORS.read_text(encoding="utf-8"), object_hook=from_notation)
    ours = vectors(known)
    files[root / VECTORS_FILE] = line_by_line(ours, 4) + "\n"
    files[root / PUBLISHED_FILE] = line_by_line(published(published_vectors(), ours), 3) + "\n"
    files[root / "docs/reference/messages.md"] = messages_page()
    return files


def published_vectors(number: int = PROTOCOL_VERSION) -> Published:
    """Return every vector that was published under a protocol number; nothing for a new one."""
    path = CHECKOUT / f"schemas/published/{number}.json"
    return json.loads(path.read_bytes()) if path.is_file() else {}


def stale_files(root: Path) -> list[Path]:
    """Return the files that are missing, out of date, or schemas of no type."""
    files = generated_files(root)
    # Those of scenarios and worlds come from stepbus_orchestrator.scenario.
    ours = {path for path in (root / SCHEMAS_FOLDER).glob("*.json") if ".schema." not in path.name}
    left_over = sorted(ours - set(files))
    return left_over + [path for path, text in files.items() if not _holds(path, text)]


def write(root: Path) -> list[Path]:
    """Bring every generated file up to date and return those that changed."""
    files = generated_files(root)
    changed = stale_files(root)
    for path in changed:
        if path in files:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(files[path], encoding="utf-8", newline="\n")
        else:
            path.unlink()
    return changed


def _holds(path: Path, text: str) -> bool:
    return path.is_file() and path.read_bytes() == text.encode()


def _indented(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, indent=2) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check the files of the checkout this module lies in; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m stepbus_schemas.generate", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, exit 1 when stale")
    check = parser.parse_args(arguments).check
    if not (CHECKOUT / "pyproject.toml").is_file():
        parser.error(f"{CHECKOUT} is no checkout of stepbus; run this from one")
    wrong = broken(published_vectors())
    for name, rows in wrong.items():
        sys.stdout.write(
            f"{name}: {len(rows)} vectors of protocol {PROTOCOL_VERSION} mean something else now, "
            f"such as {rows[0]}; add fields with a default only, or raise PROTOCOL_VERSION\n"
        )
    if wrong:
        return 1
    changed = stale_files(CHECKOUT) if check else write(CHECKOUT)
    verb = "out of date, run `python -m stepbus_schemas.generate`" if check else "written"
    for path in changed:
        sys.stdout.write(f"{path.relative_to(CHECKOUT)}: {verb}\n")
    return 1 if check and changed else 0


if __name__ == "__main__":
    sys.exit(main())
