"""Byte vectors, value ↔ hex, of message types of one's own, to test a codec in any language.

`scripts/codec_vectors.py` makes those of the types that ship, with more for a codec to prove.
"""

import json
import math
from typing import Any

import msgspec

from .catalogue import Types
from .declaration import Declaration, Row, fields_of, parts_of

NOTATION = (
    "Values are JSON, with four additions. "
    'Binary is {"$bin": "<hex>"}. '
    'A float that JSON cannot hold or may change is {"$float": "nan" | "inf" | "-inf" | "-0.0"}. '
    'An integer beyond ±(2^53 - 1) is {"$int": "<decimal digits>"}. '
    "A number written with a point or an exponent is a float64, any other an integer. "
    "`hex` is the MessagePack. Maps keep the order of the fields, and defaults are left out. "
    "Paths: `$` is the whole message, `[...]` stands for any key of a map."
)

_SAFE_INTEGER = 2**53 - 1

_TEXT = "\u0301e · 左腕 · \U0001f9be · \n\"'"
_BYTES = b"\xff\xc1\x00"


def types_vectors(types: Types) -> str:
    """Return the byte vectors of types of one's own, as JSON with a line for each."""
    by_type = {
        name: {"exact": [vector_row(*example) for example in _examples(row).items()]}
        for name, row in sorted(types.declarations.items())
    }
    return line_by_line({"notation": NOTATION, "types": by_type}, 4) + "\n"


def line_by_line(value: Any, depth: int) -> str:
    """Return JSON with a line for each item down to a depth: one for each vector."""
    if depth == 0 or not isinstance(value, dict | list):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    if isinstance(value, list):
        return "[\n" + ",\n".join(line_by_line(item, depth - 1) for item in value) + "\n]"
    pairs = (
        f"{line_by_line(key, 0)}: {line_by_line(item, depth - 1)}" for key, item in value.items()
    )
    return "{\n" + ",\n".join(pairs) + "\n}"


def vector_row(name: str, value: Any, data: bytes | None = None) -> dict[str, Any]:
    """Return a vector; data: what stands for the value, where our encoder would not write it."""
    packed = msgspec.msgpack.encode(value) if data is None else data
    return {"name": name, "value": notation(value), "hex": packed.hex()}


def notation(value: Any) -> Any:
    """Return a value as the JSON of `NOTATION`."""
    if isinstance(value, dict):
        return {key: notation(item) for key, item in value.items()}
    if isinstance(value, list):
        return [notation(item) for item in value]
    if isinstance(value, bytes):
        return {"$bin": value.hex()}
    if isinstance(value, float) and not (math.isfinite(value) and str(value) != "-0.0"):
        return {"$float": str(value)}
    if isinstance(value, int) and abs(value) > _SAFE_INTEGER:
        return {"$int": str(value)}
    return value


def _examples(declaration: Declaration) -> dict[str, dict[str, Any]]:
    """Return the exact vectors of a declared type, by name.

    `minimal` has the required fields only; `full` has all fields, none empty or at its default.
    """
    rows = fields_of(declaration)
    required = {name: row for name, row in rows.items() if not {"default", "optional"} & row.keys()}
    minimal = {name: _filled(row, 0) for name, row in required.items()}
    full = {name: _other(row) for name, row in rows.items()}
    return {"minimal": minimal, "full": {k: v for k, v in full.items() if v is not None}}


def _other(row: Row) -> Any:
    """Return a value that is neither empty nor the default; None where there is none."""
    form = row["type"]
    options = sorted(form) if isinstance(form, list) else [_filled(row, 1), _filled(row, 2)]
    return next((value for value in options if value != row.get("default")), None)


def _filled(row: Row, number: int) -> Any:
    """Return a value; another number, another value, and for 0 the smallest one."""
    scalar, sizes = parts_of(row["type"])
    least = row.get("min", 0)

    def filled(sizes: list[str], number: int) -> Any:
        if sizes:
            count = int(sizes[0]) if sizes[0].isdigit() else 2 * bool(number)
            steps = range(count) if number else [0] * count
            return [filled(sizes[1:], number + step) for step in steps]
        values = {
            "float": number + 0.5 * bool(number),
            "int": least + number,
            "bool": number == 1,
            "text": _TEXT * number,
            "bytes": _BYTES * number,
        }
        return min(row["type"]) if scalar == "words" else values[scalar]

    return filled(sizes, number)
