"""JSON Schema of declared parameters, for editors, and from that tables in Markdown."""

import inspect
import re
from collections.abc import Iterator, Mapping
from types import NoneType
from typing import Any, get_args

import msgspec
from msgspec import structs

from stepbus_participant import PerName, Settings, format_duration
from stepbus_participant.parameters.read import (
    default_of,
    fields_of,
    is_settings,
    kind_of,
    options_of,
    unmarked,
)
from stepbus_schemas import field_docstrings, listed

Schema = dict[str, Any]

_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_HEAD = "| Key | Value | Default | Meaning |\n|---|---|---|---|\n"
_DEFAULT = re.compile(r"\s*Default: (.+?)\.?$", re.DOTALL)
_REACHED = 1e18


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
        """Return the schema of settings as a map, with the keys of all their kinds."""
        tag, kinds = settings.kinds
        properties, required = {}, []
        for cls in dict.fromkeys((settings, *kinds.values())):
            texts = field_docstrings(cls)
            for key, field in fields_of(cls).items():
                words = [word for word, kind in kinds.items() if key in fields_of(kind)]
                condition = (
                    f"With `{tag}: {listed(words)}`. " if key not in fields_of(settings) else ""
                )
                text = condition + " ".join(inspect.cleandoc(texts.get(field.name, "")).split())
                properties.setdefault(key, self._property(field, text))
                if field.required and not self._partial and key not in required:
                    required.append(key)
        return {
            "description": inspect.cleandoc(settings.__doc__ or ""),
            # A key that is null counts as absent, and removes what it would inherit.
            "type": ["object", "null"],
            "properties": properties,
            **({"required": required} if required else {}),
            "additionalProperties": len(fields_of(settings)) < len(structs.fields(settings)),
        }

    def _property(self, field: structs.FieldInfo, text: str) -> Schema:
        schema = self.value(field.type)
        if field.required and not self._partial:
            return {"description": text, **schema}
        preset = {} if field.required or _DEFAULT.search(text) else _default(field)
        return {"description": text, **preset, **_nullable(schema)}

    def value(self, wanted: Any) -> Schema:
        """Return the schema of a value."""
        options = [option for option in options_of(wanted) if option is not NoneType]
        if options != [wanted]:
            parts = [part for option in options for part in _options(self.value(option))]
            return parts[0] if len(options) == 1 and len(parts) == 1 else {"anyOf": parts}
        bare, marks = unmarked(wanted)
        kind, arguments = kind_of(wanted), get_args(bare)
        if kind is PerName:
            number = self.value(options_of(marks["of"])[0])
            title = f"{form_of(number)}; one for all joints, a list, or a map by joint"
            return {"title": title, "anyOf": [number, _list(number), _map(number)]}
        if is_settings(kind):
            inner = self.reference(kind)
            return {"anyOf": [{"type": "string"}, inner]} if kind.short else inner
        if kind is dict:
            values = self.value(arguments[1])
            return _map(_nullable(values) if self._partial else values)
        schema = _leaf(wanted)
        if kind is tuple:
            count = len(arguments)
            lengths = {} if arguments[-1] is ... else {"minItems": count, "maxItems": count}
            schema = {**_list(self.value(arguments[0])), **lengths}
        for meta in getattr(wanted, "__metadata__", ()):
            title = {"title": meta.title} if meta.title else {}
            schema = {**title, **schema, **(meta.extra_json_schema or {})}
        return schema


def _leaf(wanted: Any) -> Schema:
    """Return the schema of a type without others below it, without limits that nothing reaches."""
    schema = msgspec.json.schema(wanted, schema_hook=lambda _: {"type": "string"})
    return {
        name: value
        for name, value in schema.items()
        if name != "description" and not (isinstance(value, float | int) and abs(value) > _REACHED)
    }


def _default(field: structs.FieldInfo) -> Schema:
    """Return the default as a scenario has it."""
    value = default_of(field)
    if isinstance(value, PerName):
        value = value.value
    if value in (None, (), {}, "") or isinstance(value, Settings):
        return {}
    if field.name.endswith("_ns"):
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
        items = form_of(schema["items"])
        many = "texts" if items == "text" else "numbers"
        text = f"{count} {many}" if count else f"list of {items}"
    elif "exclusiveMinimum" in schema:
        text = f"{name} > {schema['exclusiveMinimum']:g}"
    elif "minimum" in schema and "maximum" in schema:
        text = f"{name}, {schema['minimum']:g} to {schema['maximum']:g}"
    elif "minimum" in schema:
        text = f"{name} ≥ {schema['minimum']:g}"
    else:
        text = {"string": "text", "boolean": "`true`, `false`"}.get(name, name)
    return text
