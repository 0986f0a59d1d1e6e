"""Write what follows from the message types: `python -m scripts.generate_messages [--check]`.

That is the JSON Schemas, the byte vectors and `docs/reference/messages.md`. With `--check`, it
writes nothing and exits with 1 when a file is out of date.

`schemas/published/<number>.json` has every byte vector that was ever published under a protocol
number: for each type, the bytes of `exact` vectors, of `accepted` ones with the bytes that our
encoder makes of them, and of `refused` ones. New vectors are added to the file of the present
number; none is changed or removed. So a field may be added under a number, with a default, and
nothing else may change (P14.2): where a vector means something else now, this exits with 1 and
writes nothing.
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from scripts.codec_vectors import from_notation, vectors
from scripts.messages_page import messages_page

from stepbus_schemas import (
    ENVELOPE_TYPES,
    MESSAGE_TYPES,
    PROTOCOL_VERSION,
    Decoder,
    MessageError,
    encode,
    json_schema,
)
from stepbus_schemas.vectors import line_by_line

CHECKOUT = Path(__file__).resolve().parents[1]

SCHEMAS_FOLDER = "schemas/json"
VECTORS_FILE = "schemas/vectors.json"
PUBLISHED_FILE = f"schemas/published/{PROTOCOL_VERSION}.json"
_VECTORS = CHECKOUT / VECTORS_FILE

Published = dict[str, dict[str, dict[str, str]]]
"""Type → group of vectors → hex of a vector → hex of what an accepted one means."""

_GROUPS = ("exact", "accepted", "refused")


def published_vectors() -> Published:
    """Return every vector that was published under the protocol number; nothing for a new one."""
    path = CHECKOUT / PUBLISHED_FILE
    return json.loads(path.read_bytes()) if path.is_file() else {}


def published(before: Published, content: Mapping[str, Any]) -> Published:
    """Return what is published once the content of `vectors.json` is too."""
    now = {name: _of_type(groups) for name, groups in content["types"].items()}
    return {
        name: {group: _added(name, group, before, now) for group in _GROUPS}
        for name in sorted({*before, *now})
    }


def _added(name: str, group: str, before: Published, now: Published) -> dict[str, str]:
    old = before.get(name, {}).get(group, {})
    return old | now.get(name, {}).get(group, {}) | old


def _of_type(groups: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    return {
        "exact": {row["hex"]: "" for row in groups["exact"]},
        "accepted": {row["hex"]: _meaning(row["value"]) for row in groups["accepted"]},
        "refused": {row["hex"]: "" for row in groups["refused"]},
    }


def _meaning(value: Any) -> str:
    plain = json.loads(json.dumps(value), object_hook=from_notation)
    return msgspec.msgpack.encode(plain).hex()


def broken(content: Published) -> dict[str, list[str]]:
    """Return, for each type, the published vectors that our codec reads differently today."""
    failures = {name: list(_broken(name, groups)) for name, groups in content.items()}
    return {name: rows for name, rows in failures.items() if rows}


def _broken(name: str, groups: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    cls: Any = {**MESSAGE_TYPES, **ENVELOPE_TYPES}.get(name)
    if cls is None:
        yield from groups["exact"]
        return
    decode = Decoder(cls)
    fields = json_schema(name)["properties"].items()
    defaults = {field: row["default"] for field, row in fields if "default" in row}

    def encoded(data: str) -> bytes:
        """Return what our encoder makes of a vector; nothing where it is refused."""
        try:
            return encode(decode(bytes.fromhex(data)))
        except MessageError:
            return b""

    def read(data: str) -> str:
        """Return what a vector means, with its defaults; nothing where it is refused."""
        # As text: NaN equals NaN there, and -0.0 is not 0.0.
        value = encoded(data)
        return repr(defaults | msgspec.msgpack.decode(value)) if value else ""

    yield from (data for data in groups["exact"] if encoded(data).hex() != data)
    for data, meaning in groups["accepted"].items():
        if not read(data) or read(data) != read(meaning):
            yield data
    yield from (data for data in groups["refused"] if encoded(data))


def generated_files(root: Path) -> dict[Path, str | None]:
    """Return path → content of every generated file; None: of no type, to be removed."""
    # The schemas of scenarios and worlds come from generate_parameters.py.
    present = (root / SCHEMAS_FOLDER).glob("*.json")
    files: dict[Path, str | None] = {p: None for p in sorted(present) if ".schema." not in p.name}
    for name in (*MESSAGE_TYPES, *ENVELOPE_TYPES):
        path = root / SCHEMAS_FOLDER / f"{name.replace('/', '.')}.json"
        files[path] = indented(json_schema(name))
    known = json.loads(_VECTORS.read_text(encoding="utf-8"), object_hook=from_notation)
    ours = vectors(known)
    files[root / VECTORS_FILE] = line_by_line(ours, 4) + "\n"
    files[root / PUBLISHED_FILE] = line_by_line(published(published_vectors(), ours), 3) + "\n"
    files[root / "docs/reference/messages.md"] = messages_page()
    return files


def indented(value: Any) -> str:
    """Return the text of a JSON file."""
    return json.dumps(value, ensure_ascii=False, indent=2) + "\n"


def bring_up_to_date(
    arguments: Sequence[str] | None, command: str, files: Callable[[], Mapping[Path, str | None]]
) -> int:
    """Write the files that differ from their content, or only name them; return the exit code.

    arguments: of the command. files: path → content; None: the file is to be removed.
    """
    parser = argparse.ArgumentParser(prog=command, description="Write the generated files.")
    parser.add_argument("--check", action="store_true", help="write nothing, exit 1 when stale")
    check = parser.parse_args(arguments).check
    stale = False
    for path, text in files().items():
        if (path.read_bytes() if path.is_file() else None) == (text and text.encode()):
            continue
        stale = True
        if not check and text is None:
            path.unlink()
        elif not check:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text or "", encoding="utf-8", newline="\n")
        verb = f"out of date, run `{command}`" if check else "written"
        sys.stdout.write(f"{path.relative_to(CHECKOUT)}: {verb}\n")
    return 1 if check and stale else 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check the files of this checkout; return the exit code."""
    wrong = broken(published_vectors())
    for name, rows in wrong.items():
        sys.stdout.write(
            f"{name}: {len(rows)} vectors of protocol {PROTOCOL_VERSION} changed their meaning, "
            f"such as {rows[0]}; only add fields with a default, or raise PROTOCOL_VERSION\n"
        )
    if wrong:
        return 1
    command = "python -m scripts.generate_messages"
    return bring_up_to_date(arguments, command, partial(generated_files, CHECKOUT))


if __name__ == "__main__":
    sys.exit(main())
