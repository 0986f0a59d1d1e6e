"""Message types that a user declares: rows of plain data, from which a class follows, and back.

A row is a field: its type, such as `float[n,3]`, and where given `unit`, `help`, `optional`,
`default`, `min`. It is what all that lists the fields of a type goes by.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Annotated, Any, Literal, cast

import msgspec

from .codec import explained, type_name
from .errors import WiringError
from .messages import MESSAGE_TYPES, Message, meta
from .protocol import ENVELOPE_TYPES

_Keys = tuple[str | int, ...]
Row = Mapping[str, Any]
Declaration = dict[str, Any]
"""A message type as declared: field → its row, and `help`, a sentence about the type."""

_HELP = "help"
_MOST_FIELDS = 15
"""A MessagePack map of so many fields has a header of one byte, in every encoder."""
_LONGEST_ARRAY = 64
"""Most entries of fixed sizes; anything longer is a list with a size by name."""
_MOST_SIZES = 3

_KEYS: Mapping[str, Any] = {
    "type": Any,
    "unit": str,
    "help": str,
    "optional": bool,
    "default": Any,
    "min": Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)],
}
_SCALARS: Mapping[str, Any] = {
    "float": float,
    "int": int,
    "bool": bool,
    "text": str,
    "bytes": bytes,
}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,47}/[1-9][0-9]{0,4}")
_FIELD = re.compile(r"[a-z][a-z0-9_]{0,30}")
_FORM = re.compile(r"(\w+)(?:\[([^\[\]]*)\])?")
_SIZE = re.compile(r"[1-9][0-9]*|[a-z][a-z0-9_]*")
_FORMS = "float, int, bool, text, bytes, a list of words or an array such as float[3] or float[n]"
_PROTOCOL = frozenset(name.partition("/")[0] for name in ENVELOPE_TYPES)


def normal(declaration: Mapping[str, Any]) -> Declaration:
    """Return a declaration in full, each field as a map with the keys that are set."""
    rows = {name: _normal_row(row) for name, row in declaration.items() if name != _HELP}
    text = declaration.get(_HELP)
    return {**({_HELP: text} if text else {}), **rows}


def fields_of(declaration: Declaration) -> dict[str, Row]:
    """Return the rows of a declaration in full, by field."""
    return {name: row for name, row in declaration.items() if name != _HELP}


def _normal_row(row: object) -> dict[str, Any]:
    """Return a field in full: a text or a list of words stands for its type."""
    given = dict(row) if isinstance(row, Mapping) else {"type": row}
    form = given.get("type")
    if isinstance(form, str):
        given["type"] = form.replace(" ", "")
    elif isinstance(form, Sequence):
        given["type"] = list(form)
    return {key: given[key] for key in (*_KEYS, *given) if _counts(key, given.get(key))}


def _counts(key: str, value: object) -> bool:
    """Return whether a value says anything; a default may be 0, false or empty."""
    return value is not None and (key == "default" or (value != "" and value is not False))


def parts_of(form: Any) -> tuple[str, list[str]]:
    """Return a type such as `float[n,3]` as scalar and sizes; a list of words is `words`.

    Raises ValueError with the reason why it is none.
    """
    if isinstance(form, list):
        good = all(isinstance(word, str) and word for word in form)
        if not form or not good or len(set(form)) < len(form):
            raise ValueError("a list holds the allowed words: distinct strings")
        return "words", []
    match = _FORM.fullmatch(form) if isinstance(form, str) else None
    if match is None or match[1] not in _SCALARS:
        raise ValueError(f"must be {_FORMS}, not {form!r}")
    sizes = [] if match[2] is None else match[2].split(",")
    for size in sizes:
        if not _SIZE.fullmatch(size):
            raise ValueError(
                f"{size!r} is not a size; write a number, n for one entry per name in the port's "
                "description, or another name such as k for any length"
            )
    fixed = math.prod(int(size) for size in sizes if size.isdigit())
    if fixed > _LONGEST_ARRAY:
        raise ValueError(
            f"a fixed array has at most {_LONGEST_ARRAY} entries, not {fixed}; give its size a "
            f"name, such as {match[1]}[k]"
        )
    if len(sizes) > _MOST_SIZES:
        raise ValueError(f"has {len(sizes)} sizes, at most {_MOST_SIZES}")
    return match[1], sizes


def type_problems(name: str, declaration: object) -> Iterator[tuple[_Keys, str]]:
    """Yield what is wrong with a type: keys below it and a sentence each."""
    if not _NAME.fullmatch(name):
        yield (), f"{name!r} is not a type name; write Name/major, such as Thruster/1"
    elif name in MESSAGE_TYPES:
        yield (), f"{name} ships with stepbus; choose another name"
    elif name.partition("/")[0] in _PROTOCOL:
        yield (), f"{name} is a protocol message; choose another name"
    if not isinstance(declaration, Mapping):
        yield (), "must be a map: field → type, such as {force: {type: 'float[3]', unit: N}}"
        return
    full = normal(declaration)
    if not isinstance(full.get(_HELP, ""), str):
        yield (_HELP,), "describes the type; choose another name for the field"
    fields = fields_of(full)
    if not 0 < len(fields) <= _MOST_FIELDS:
        yield (), f"has {len(fields)} fields; it needs 1 to {_MOST_FIELDS}"
    for field, row in fields.items():
        if not _FIELD.fullmatch(field):
            yield (field,), f"{field!r} is not a field name; use lowercase letters, digits and _"
        problems = list(_row_problems(row)) or list(_default_problems(row))
        yield from (((field, *keys), text) for keys, text in problems)


def _row_problems(row: Row) -> Iterator[tuple[_Keys, str]]:
    for key, value in row.items():
        try:
            msgspec.convert(value, _KEYS[key])
        except KeyError:
            yield (key,), f"unknown key {key!r}; known: {', '.join(_KEYS)}"
        except msgspec.ValidationError as exc:
            yield (key,), explained(exc)
    if "type" not in row:
        yield (), f"'type' is missing: {_FORMS}"
        return
    try:
        parts_of(row["type"])
    except ValueError as exc:
        yield ("type",), str(exc)
    if "min" in row and row["type"] != "int":
        yield ("min",), "must be on a field of type int"


def _default_problems(row: Row) -> Iterator[tuple[_Keys, str]]:
    """Yield why a default does not fit a field that is fine otherwise."""
    if "default" not in row:
        return
    if row.get("optional"):
        yield ("default",), "is not allowed: an optional field is absent by default"
    elif parts_of(row["type"])[0] == "bytes":
        yield ("default",), "is not allowed for bytes; make the field optional"
    else:
        hint = _annotation(row)
        try:
            msgspec.convert(row["default"], hint)
            json.dumps(row["default"], allow_nan=False)
        except msgspec.ValidationError as exc:
            yield ("default",), f"does not match the type: {explained(exc, hint)}"
        except ValueError:
            yield ("default",), "must be finite"


def declare(name: str, declaration: Mapping[str, Any]) -> type[Message]:
    """Return the class of a declared type, the same one for the same declaration.

    Raises WiringError that lists what is wrong with it.
    """
    problems = [
        ".".join((name, *map(str, keys))) + f": {text}"
        for keys, text in type_problems(name, declaration)
    ]
    if problems:
        raise WiringError("\n".join(problems))
    return _declared(name, json.dumps(normal(declaration)))


@lru_cache(maxsize=1024)
def _declared(name: str, text: str) -> type[Message]:
    declaration = json.loads(text)
    rows = fields_of(declaration).items()
    cls = msgspec.defstruct(
        name.partition("/")[0],
        [(field, _annotation(row), *_default_of(row)) for field, row in rows],
        bases=(Message,),
        namespace={"TYPE": name, "__doc__": declaration.get(_HELP)},
        frozen=True,
        kw_only=True,
    )
    return cast("type[Message]", cls)


def _annotation(row: Row) -> Any:
    """Return the type of a field, with its metadata."""
    form = row["type"]
    scalar, sizes = parts_of(form)
    hint: Any = Literal[tuple(form)] if scalar == "words" else _SCALARS[scalar]
    if "min" in row:
        hint = Annotated[hint, msgspec.Meta(ge=row["min"])]
    for size in reversed(sizes):
        hint = (
            tuple.__class_getitem__((hint,) * int(size))
            if size.isdigit()
            else list.__class_getitem__(hint)
        )
    if row.get("optional"):
        hint = hint | None
    more: dict[str, Any] = {}
    # msgspec sorts the words; their order counts in format raw.
    if scalar == "words" and form != sorted(form):
        more["words"] = form
    # Nor does it know what a factory makes.
    if "default" in row and sizes and not sizes[0].isdigit():
        more["default"] = row["default"]
    described = meta(row.get("help", ""), row.get("unit", ""), " ".join(sizes), more=more)
    return Annotated[hint, described]


def _default_of(row: Row) -> tuple[Any, ...]:
    """Return the default of a field as a row of one; none for a required field."""
    if row.get("optional"):
        return (None,)
    if "default" not in row:
        return ()
    value = msgspec.convert(row["default"], _annotation(row))
    if isinstance(value, list):
        return (msgspec.field(default_factory=lambda: list(value)),)
    return (value,)


def class_declaration(cls: type[Message]) -> Declaration:
    """Return the declaration of a message class; raises WiringError where there is none."""
    name = type_name(cls)
    try:
        (_,), parts = msgspec.json.schema_components([cls], ref_template="{name}")
    except TypeError as exc:
        raise WiringError(f"{name}: {exc}") from exc
    return declaration_of(name, parts[cls.__name__])


def declaration_of(name: str, schema: Mapping[str, Any]) -> Declaration:
    """Return the declaration that a type's JSON Schema says.

    Raises WiringError for a field that no declaration can say.
    """
    declaration: Declaration = {_HELP: schema["description"]} if schema.get("description") else {}
    for field, node in schema["properties"].items():
        try:
            declaration[field] = row_of(node, required=field in schema.get("required", []))
        except (ValueError, KeyError, TypeError) as exc:
            raise WiringError(f"{name}.{field}: {exc}") from exc
    return declaration


def not_null(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON Schema of what an optional field is when it is there."""
    options: list[dict[str, Any]] = schema.get("anyOf", [])
    return next((option for option in options if option != {"type": "null"}), schema)


def row_of(schema: dict[str, Any], *, required: bool) -> dict[str, Any]:
    """Return a field's JSON Schema as declared; raises ValueError where that cannot say it."""
    inner = not_null(schema)
    row: dict[str, Any] = {"type": _form_of(inner, schema)}
    row |= {"unit": schema.get("unit"), "help": schema.get("description")}
    if "anyOf" in schema:
        if required or schema["default"] is not None or len(schema["anyOf"]) != 2:
            raise ValueError("a field that may be None must have the default None and one type")
        row["optional"] = True
    elif not required:
        if "default" not in schema:
            raise ValueError("its default comes from a function; remove it, or use []")
        row["default"] = schema["default"]
    row["min"] = inner.get("minimum")
    return _normal_row(row)


_JSON_NAMES = {"number": "float", "integer": "int", "boolean": "bool", "string": "text"}
_UNSAID = {"maximum", "exclusiveMinimum", "exclusiveMaximum", "pattern", "$ref"}


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
    scalar = "bytes" if "contentEncoding" in node else _JSON_NAMES.get(str(node.get("type")), "")
    if not scalar or node.keys() & _UNSAID:
        raise ValueError(
            f"a field must be {_FORMS}; maps, structs and bounds other than `ge` of "
            "an int are not supported"
        )
    return f"{scalar}[{','.join(sizes)}]" if sizes else scalar


def differences(one: Declaration, other: Declaration) -> Iterator[tuple[str, str, str]]:
    """Yield (field, declaration, other declaration) of each field in which two types differ.

    A field of only one of them is no difference if it may be left out (P14.2).
    """
    first, second = fields_of(one), fields_of(other)
    for field in dict.fromkeys((*first, *second)):
        rows = [row for row in (first.get(field), second.get(field)) if row is not None]
        texts = [_shown(fields.get(field)) for fields in (first, second)]
        is_added = len(rows) == 1 and ("default" in rows[0] or "optional" in rows[0])
        if texts[0] != texts[1] and not is_added:
            yield field, texts[0], texts[1]


def _shown(row: Row | None) -> str:
    """Return a field as declared, without its help."""
    if row is None:
        return "absent"
    others = {key: value for key, value in row.items() if key not in ("type", _HELP)}
    words = (f", {k} {json.dumps(v, ensure_ascii=False)}" for k, v in others.items())
    return f"of type {row['type']}{''.join(words)}"
