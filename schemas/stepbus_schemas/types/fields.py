"""Fields of a declared message type: `float[n]`, with unit, default and help."""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

import msgspec

from stepbus_schemas.messages.base import meta

from .decode_errors import explained

Keys = tuple[str | int, ...]
Row = Mapping[str, Any]
"""A field as declared: `type`, and where given `unit`, `help`, `optional`, `default`, `min`."""

SCALARS: Mapping[str, Any] = {
    "float": float,
    "int": int,
    "bool": bool,
    "text": str,
    "bytes": bytes,
}
KEYS = ("type", "unit", "help", "optional", "default", "min")
LONGEST_ARRAY = 64
"""Most entries of fixed sizes; anything longer is a list with a size by name."""
MOST_SIZES = 3
_FORM = re.compile(r"(\w+)(?:\[([^\[\]]*)\])?")
_SIZE = re.compile(r"[1-9][0-9]*|[a-z][a-z0-9_]*")
_FORMS = "float, int, bool, text, bytes, a list of words, or an array such as float[3] or float[n]"


def parse_form(form: object) -> tuple[str, list[str]]:
    """Return a type such as `float[n,3]` as scalar and sizes; raises ValueError with the reason."""
    match = _FORM.fullmatch(form.replace(" ", "")) if isinstance(form, str) else None
    if match is None or match[1] not in SCALARS:
        raise ValueError(f"must be {_FORMS}, not {form!r}")
    sizes = [] if match[2] is None else match[2].split(",")
    for size in sizes:
        if not _SIZE.fullmatch(size):
            raise ValueError(
                f"{size!r} is no size; write a number, n for one entry for each name of the "
                "port's description, or another name such as k for any length"
            )
    fixed = math.prod(int(size) for size in sizes if size.isdigit())
    if fixed > LONGEST_ARRAY:
        raise ValueError(
            f"an array of {fixed} is too long to be fixed (at most {LONGEST_ARRAY}); name its "
            f"size, such as {match[1]}[k]"
        )
    if len(sizes) > MOST_SIZES:
        raise ValueError(f"has {len(sizes)} sizes, at most {MOST_SIZES}")
    return match[1], sizes


def normal_row(row: object) -> dict[str, Any]:
    """Return a field in full: a text or a list of words stands for its type."""
    given = dict(row) if isinstance(row, Mapping) else {"type": row}
    form = given.get("type")
    if isinstance(form, str):
        given["type"] = form.replace(" ", "")
    elif isinstance(form, Sequence):
        given["type"] = list(form)
    return {key: given[key] for key in (*KEYS, *given) if _counts(key, given.get(key))}


def _counts(key: str, value: object) -> bool:
    """Return whether a value says anything; a default may be 0, false or empty."""
    return value is not None and (key == "default" or (value != "" and value is not False))


def row_problems(row: Row) -> Iterator[tuple[Keys, str]]:
    """Yield what is wrong with a field in full."""
    for key in row:
        if key not in KEYS:
            yield (key,), f"unknown key {key!r}; known: {', '.join(KEYS)}"
    if "type" not in row:
        yield (), f"'type' is missing: {_FORMS}"
        return
    yield from _type_problems(row["type"])
    for key in ("unit", "help"):
        if not isinstance(row.get(key, ""), str):
            yield (key,), f"must be text, not {row[key]!r}"
    if row.get("optional", True) is not True:
        yield ("optional",), f"must be true or false, not {row['optional']!r}"
    if "min" in row and (row["type"] != "int" or not is_integer(row["min"])):
        yield ("min",), "is a whole number, for a field of type int"
    elif "min" in row and not -(2**63) <= row["min"] < 2**63:
        yield ("min",), "must fit into 64 bits, with a sign"


def default_problems(row: Row) -> Iterator[tuple[Keys, str]]:
    """Yield why a default does not fit a field that is fine otherwise."""
    if "default" not in row:
        return
    if row.get("optional"):
        yield ("default",), "is not for an optional field, which is absent by default"
    elif str(row["type"]).startswith("bytes"):
        yield ("default",), "is not for bytes; make the field optional"
    else:
        try:
            msgspec.convert(row["default"], annotation(row))
        except msgspec.ValidationError as exc:
            yield ("default",), f"does not fit the type: {explained(exc, annotation(row))}"
            return
        try:
            json.dumps(row["default"], allow_nan=False)
        except ValueError:
            yield ("default",), "must be finite: JSON Schema has no other numbers"


def _type_problems(form: Any) -> Iterator[tuple[Keys, str]]:
    if isinstance(form, list):
        good = all(isinstance(word, str) and word for word in form)
        if not form or not good or len(set(form)) < len(form):
            yield ("type",), "a list has the words that the field may hold: different texts"
        return
    try:
        parse_form(form)
    except ValueError as exc:
        yield ("type",), str(exc)


def is_integer(value: object) -> bool:
    """Return whether a value is an integer, and no boolean."""
    return isinstance(value, int) and not isinstance(value, bool)


def annotation(row: Row) -> Any:
    """Return the type of a field, with its metadata."""
    form = row["type"]
    if isinstance(form, list):
        hint: Any = Literal[tuple(form)]
        sizes: list[str] = []
    else:
        scalar, sizes = parse_form(form)
        hint = SCALARS[scalar]
        for size in reversed(sizes):
            hint = (
                tuple.__class_getitem__((hint,) * int(size))
                if size.isdigit()
                else list.__class_getitem__(hint)
            )
    if row.get("optional"):
        hint = hint | None
    shape, least = " ".join(sizes), row.get("min")
    described = meta(row.get("help", ""), row.get("unit", ""), shape, ge=least)
    more: dict[str, Any] = {}
    # msgspec sorts the words; their order counts in format raw.
    if isinstance(form, list) and form != sorted(form):
        more["words"] = form
    # Nor does it know what a factory makes.
    if "default" in row and _is_list(sizes):
        more["default"] = row["default"]
    if more:
        extra = {**(described.extra_json_schema or {}), **more}
        described = msgspec.Meta(
            description=described.description, ge=described.ge, extra_json_schema=extra
        )
    return Annotated[hint, described]


def _is_list(sizes: Sequence[str]) -> bool:
    """Return whether an array is a list, and no tuple of fixed size."""
    return bool(sizes) and not sizes[0].isdigit()


def default_of(row: Row) -> tuple[Any, ...]:
    """Return the default of a field as a row of one; none for a required field."""
    if row.get("optional"):
        return (None,)
    if "default" not in row:
        return ()
    value = msgspec.convert(row["default"], annotation(row))
    if isinstance(value, list):
        return (msgspec.field(default_factory=lambda: list(value)),)
    return (value,)


def row_of(schema: Mapping[str, Any], *, required: bool) -> dict[str, Any]:
    """Return a field's JSON Schema as declared; raises ValueError where that cannot say it."""
    inner = next((item for item in schema.get("anyOf", []) if item != {"type": "null"}), schema)
    row: dict[str, Any] = {"type": _form_of(inner, schema)}
    row |= {"unit": schema.get("unit"), "help": schema.get("description")}
    if "anyOf" in schema:
        if required or schema["default"] is not None or len(schema["anyOf"]) != 2:
            raise ValueError("a field that may be None must be None by default, and of one type")
        row["optional"] = True
    elif not required:
        if "default" not in schema:
            raise ValueError("its default is made by a function; leave it out, or make it []")
        row["default"] = schema["default"]
    row["min"] = inner.get("minimum")
    return normal_row(row)


def _form_of(node: Mapping[str, Any], field: Mapping[str, Any]) -> Any:
    if "enum" in node:
        return field.get("words", node["enum"])
    sizes, names = [], list(field.get("shape", []))
    while node.get("type") == "array":
        given = names.pop(0) if names else "k"
        if "prefixItems" in node:
            items = node["prefixItems"]
            if any(item != items[0] for item in items):
                raise ValueError("the entries of a tuple must have the same type")
            sizes.append(str(len(items)))
            node = items[0]
        else:
            sizes.append("k" if given.isdigit() else given)
            node = node.get("items", {})
    scalar = _scalar_of(node)
    return f"{scalar}[{','.join(sizes)}]" if sizes else scalar


_NAMES = {"number": "float", "integer": "int", "boolean": "bool", "string": "text"}


def _scalar_of(node: Mapping[str, Any]) -> str:
    name = "bytes" if "contentEncoding" in node else _NAMES.get(str(node.get("type")), "")
    extra = node.keys() & {"maximum", "exclusiveMinimum", "exclusiveMaximum", "pattern", "$ref"}
    if not name or extra:
        raise ValueError(f"a field is {_FORMS}; no map, no struct, no bounds but `ge` of an int")
    return name
