"""What declared parameters mean: JSON Schema for editors, and from that tables in Markdown."""

import inspect
import re
from collections.abc import Iterator, Mapping
from typing import Any

from msgspec import inspect as types

from stepbus_participant import PerName, Settings, format_duration
from stepbus_participant.parameters import (
    conditions,
    default,
    is_own,
    mark,
    options_of,
    plain,
)
from stepbus_schemas import field_docstrings, listed

Schema = dict[str, Any]

_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_HEAD = "| Key | Value | Default | Meaning |\n|---|---|---|---|\n"
_DEFAULT = re.compile(r"\s*Default: (.+?)\.?$", re.DOTALL)
_MARKED: Mapping[str, Schema] = {
    "duration": {"title": "duration"},
    "pause": {"title": "duration, or `0s`"},
    "name": {"title": "name"},
    "file": {"title": "file"},
    "model": {"title": "file"},
    "names": {
        "title": "list of names",
        "type": "array",
        "items": {"type": "string"},
        "uniqueItems": True,
    },
    "plugin": {
        "title": "`file.py:Class`",
        "type": "string",
        "pattern": r"^([\w.]+|.+\.py):\w+$",
    },
}
"""Mark of a type → what its schema has beside, or instead of, that of the marked type."""


class SchemaWriter:
    """Collects the definitions that a schema refers to.

    partial: nothing is required: a scenario may extend another one.
    """

    def __init__(self, *, partial: bool = False) -> None:
        self.definitions: dict[str, Schema] = {}
        self._partial = partial

    def document(self, settings: type[Settings], title: str) -> Schema:
        """Return a complete schema."""
        root = self.struct(settings)
        return {"$schema": _DRAFT, "title": title, **root, "$defs": self.definitions}

    def reference(self, settings: type[Settings]) -> Schema:
        """Return a reference to settings, whose definition is added."""
        module = settings.__module__.removeprefix("stepbus_").replace("_", "-")
        name = f"{module}.{settings.__name__}"
        if name not in self.definitions:
            self.definitions[name] = {}
            self.definitions[name] = self.struct(settings)
        return {"$ref": f"#/$defs/{name}"}

    def struct(self, settings: type[Settings]) -> Schema:
        """Return the schema of settings as a map."""
        texts: dict[str, str] = {}
        for cls in reversed(settings.__mro__):
            if issubclass(cls, Settings) and cls is not Settings:
                texts |= field_docstrings(cls)
        fields = getattr(types.type_info(settings), "fields", ())
        keys = [field for field in fields if not is_own(field)]
        required = [f.encode_name for f in keys if f.required and not self._partial]
        return {
            "description": inspect.cleandoc(settings.__doc__ or ""),
            # A key that is null counts as absent, and removes what it would inherit.
            "type": ["object", "null"],
            "properties": {
                field.encode_name: self._property(field, texts.get(field.name, ""))
                for field in keys
            },
            **({"required": required} if required else {}),
            "additionalProperties": len(keys) < len(fields),
        }

    def _property(self, field: types.Field, docstring: str) -> Schema:
        text = " ".join(inspect.cleandoc(docstring).split())
        wanted = " and ".join(f"`{k}: {listed(v)}`" for k, v in conditions(field).items())
        described = {"description": f"With {wanted}. {text}" if wanted else text}
        schema = self.value(field.type)
        if field.required and not self._partial:
            return {**described, **schema}
        preset = {} if field.required or _DEFAULT.search(text) else _default(field)
        return {**described, **preset, **_nullable(schema)}

    def value(self, node: types.Type) -> Schema:
        """Return the schema of a value."""
        extra = (node.extra_json_schema if isinstance(node, types.Metadata) else None) or {}
        form = mark(node)
        if form in _MARKED:
            return {**_MARKED[form], **extra}
        if form == "per_name" and isinstance(node, types.Metadata):
            number = self.value(types.type_info((node.extra or {})["item"]))
            title = f"{form_of(number)}; one for all joints, a list, or a map by joint"
            return {"title": title, "anyOf": [number, _list(number), _map(number)]}
        options = options_of(node)
        if options == [plain(node)]:
            return self._plain(options[0])
        return {"anyOf": [part for option in options for part in _options(self.value(option))]}

    def _plain(self, node: types.Type) -> Schema:
        match node:
            case types.StructType():
                if not issubclass(node.cls, Settings):
                    raise TypeError(f"{node.cls} is declared without Settings")
                inner = self.reference(node.cls)
                form = {"anyOf": [{"type": "string"}, inner]} if node.cls.short else inner
            case types.DictType():
                values = self.value(node.value_type)
                form = _map(_nullable(values) if self._partial else values)
            case types.VarTupleType():
                form = _list(self.value(node.item_type))
            case types.TupleType():
                count = len(node.item_types)
                items = self.value(node.item_types[0])
                form = {**_list(items), "minItems": count, "maxItems": count}
            case types.LiteralType():
                form = {"enum": list(node.values)}
            case types.IntType() | types.FloatType():
                name = "integer" if isinstance(node, types.IntType) else "number"
                rows = {"exclusiveMinimum": node.gt, "minimum": node.ge, "maximum": node.le}
                limits = {k: v for k, v in rows.items() if v is not None and abs(v) < 1e18}
                form = {"type": name, **limits}
            case types.BoolType():
                form = {"type": "boolean"}
            case types.StrType():
                form = {"type": "string"}
            case _:
                form = {}
        return form


def _default(field: types.Field) -> Schema:
    """Return the default as a scenario has it."""
    value: Any = default(field)
    if isinstance(value, PerName):
        value = float(repr(value).removeprefix("each(").removesuffix(")"))
    if value in (None, (), {}, "") or isinstance(value, Settings):
        return {}
    if any(mark(item) in ("duration", "pause") for item in (field.type, *options_of(field.type))):
        return {"default": format_duration(value) if value else "0s"}
    return {"default": list(value) if isinstance(value, tuple) else value}


def _nullable(schema: Schema) -> Schema:
    """Return a schema that null fits too."""
    if isinstance(schema.get("type"), str):
        return {**schema, "type": [schema["type"], "null"]}
    if "enum" in schema:
        return {**schema, "enum": [*schema["enum"], None]}
    if "anyOf" in schema:
        return {**schema, "anyOf": [*schema["anyOf"], {"type": "null"}]}
    return schema


def _options(schema: Schema) -> list[Schema]:
    return list(schema["anyOf"]) if set(schema) == {"anyOf"} else [schema]


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _map(values: Schema) -> Schema:
    return {"type": "object", "additionalProperties": values}


def tables(settings: type[Settings], *, only: bool) -> str:
    """Return the keys of settings as a table, followed by one for each map below.

    only: without those.
    """
    document = SchemaWriter().document(settings, "")
    text = _table(document)
    parts: dict[str, str] = {}
    for path, name in () if only else _parts(document, document["$defs"]):
        parts.setdefault(name, path)
    for name, path in parts.items():
        part = document["$defs"][name]
        summary = " ".join(part["description"].partition("\n\n")[0].split())
        text += f"\n`{path}`: {summary}\n\n{_table(part)}"
    return text


def _parts(schema: Schema, definitions: Mapping[str, Schema]) -> Iterator[tuple[str, str]]:
    """Yield the maps below one: the keys that lead to each, `stock.types.*`, and its definition."""
    for key, value in schema["properties"].items():
        for path, name in _references(value, key):
            yield path, name
            for below, inner in _parts(definitions[name], definitions):
                yield f"{path}.{below}", inner


def _references(schema: Schema, path: str) -> Iterator[tuple[str, str]]:
    if "$ref" in schema:
        yield path, schema["$ref"].rpartition("/")[2]
    for option in schema.get("anyOf", ()):
        yield from _references(option, path)
    if isinstance(schema.get("additionalProperties"), dict):
        yield from _references(schema["additionalProperties"], f"{path}.*")
    if "items" in schema:
        yield from _references(schema["items"], f"{path}[]")


def _table(schema: Schema) -> str:
    text = _HEAD
    for key, row in schema["properties"].items():
        stated = _DEFAULT.search(row["description"])
        shown = _shown(row.get("default"))
        preset = "required" if key in schema.get("required", ()) else shown
        meaning = row["description"][: stated.start()] if stated else row["description"]
        cells = (f"`{key}`", form_of(row), stated[1] if stated else preset, meaning)
        text += f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |\n"
    return text


def _shown(value: Any) -> str:
    match value:
        case None:
            return "none"
        case bool():
            return "true" if value else "false"
        case float():
            return f"{value:g}"
        case list():
            return f"[{', '.join(map(_shown, value))}]"
        case _:
            return str(value)


def form_of(schema: Schema) -> str:
    """Return what a value looks like: `number > 0`, `list of text`."""
    kinds = schema.get("type", "any")
    name = kinds if isinstance(kinds, str) else kinds[0]
    options = [option for option in schema.get("anyOf", ()) if option != {"type": "null"}]
    values = schema.get("additionalProperties")
    if "title" in schema:
        text = str(schema["title"])
    elif "enum" in schema:
        text = ", ".join(f"`{word}`" for word in schema["enum"] if word is not None)
    elif options:
        text = " or ".join(dict.fromkeys(map(form_of, options)))
    elif "$ref" in schema or name == "object":
        text = f"map: name → {form_of(values)}" if isinstance(values, dict) else "map"
    elif name == "array":
        count = schema.get("minItems")
        text = f"{count} numbers" if count else f"list of {form_of(schema['items'])}"
    elif "exclusiveMinimum" in schema:
        text = f"{name} > {schema['exclusiveMinimum']:g}"
    elif "minimum" in schema and "maximum" in schema:
        text = f"{name}, {schema['minimum']:g} to {schema['maximum']:g}"
    elif "minimum" in schema:
        text = f"{name} ≥ {schema['minimum']:g}"
    else:
        text = {"string": "text", "boolean": "`true`, `false`"}.get(name, name)
    return text
