"""Declared parameters as JSON Schema, for completion and checks in an editor."""

import inspect
from collections.abc import Mapping
from typing import Any

from msgspec import inspect as types

from stepbus_orchestrator.scenario.parameter_tables import (
    descriptions,
    fields_of,
    is_duration,
    settings_of,
    show_default,
)
from stepbus_participant import Settings
from stepbus_participant.parameters import default, is_own, mark, options_of, plain

_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_NULL = {"type": "null"}


class SchemaWriter:
    """Collects the definitions that a schema refers to.

    partial: nothing is required: a scenario may extend another one.
    """

    def __init__(self, *, partial: bool = False) -> None:
        self.definitions: dict[str, Any] = {}
        self._partial = partial

    def document(self, settings: type[Settings], title: str) -> dict[str, Any]:
        """Return a complete schema."""
        root = self.struct(settings)
        return {"$schema": _DRAFT, "title": title, **root, "$defs": self.definitions}

    def reference(self, settings: type[Settings]) -> dict[str, Any]:
        """Return a reference to settings, whose definition is added."""
        module = settings.__module__.removeprefix("stepbus_").replace("_", "-")
        name = f"{module}.{settings.__name__}"
        if name not in self.definitions:
            self.definitions[name] = {}
            self.definitions[name] = self.struct(settings)
        return {"$ref": f"#/$defs/{name}"}

    def struct(self, settings: type[Settings]) -> dict[str, Any]:
        """Return the schema of settings as a map."""
        texts = descriptions(settings)
        fields = fields_of(settings)
        required = [f.encode_name for f in fields if f.required and not self._partial]
        everything = getattr(types.type_info(settings), "fields", ())
        return {
            "description": inspect.cleandoc(settings.__doc__ or ""),
            # A key that is null counts as absent, and removes what it would inherit.
            "type": ["object", "null"],
            "properties": {
                field.encode_name: self._property(field, texts.get(field.name, ""))
                for field in fields
            },
            **({"required": required} if required else {}),
            "additionalProperties": any(map(is_own, everything)),
        }

    def _property(self, field: types.Field, text: str) -> dict[str, Any]:
        row = self.value(field.type)
        described = {"description": text} if text else {}
        if field.required and not self._partial:
            return {**described, **row}
        preset = {} if field.required or "Default:" in text else _default(field)
        return {**described, **preset, **_nullable(row)}

    def value(self, node: types.Type) -> dict[str, Any]:
        """Return the schema of a value."""
        if isinstance(node, types.Metadata) and node.extra_json_schema:
            return dict(node.extra_json_schema)
        form = mark(node)
        if form == "per_name" and isinstance(node, types.Metadata):
            number = self.value(types.type_info((node.extra or {})["item"]))
            return {"anyOf": [number, _list(number), _map(number)]}
        if form == "names":
            return {"type": "array", "items": {"type": "string"}, "uniqueItems": True}
        if form == "plugin":
            return {"type": "string", "pattern": r"^[\w.]+:\w+$"}
        options = options_of(node)
        if options == [plain(node)]:
            return self._plain(options[0])
        return {"anyOf": [part for option in options for part in _options(self.value(option))]}

    def _plain(self, node: types.Type) -> dict[str, Any]:
        match node:
            case types.StructType():
                cls = settings_of(node)
                inner = self.reference(cls)
                form = {"anyOf": [{"type": "string"}, inner]} if cls.short else inner
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
                form = _number(node)
            case types.BoolType():
                form = {"type": "boolean"}
            case types.StrType():
                form = {"type": "string"}
            case _:
                form = {}
        return form


def _default(field: types.Field) -> dict[str, Any]:
    shown, value = show_default(field), default(field)
    plain_value = value if isinstance(value, bool | int | float) else shown
    if is_duration(field.type):
        plain_value = shown
    return {} if shown == "none" else {"default": plain_value}


def _nullable(schema: dict[str, Any]) -> dict[str, Any]:
    """Return a schema that null fits too."""
    if isinstance(schema.get("type"), str):
        return {**schema, "type": [schema["type"], "null"]}
    if "$ref" in schema:
        return schema
    if "enum" in schema:
        return {**schema, "enum": [*schema["enum"], None]}
    return {"anyOf": [*_options(schema), _NULL]} if schema else schema


def _options(schema: dict[str, Any]) -> list[Any]:
    return list(schema["anyOf"]) if set(schema) == {"anyOf"} else [schema]


def _list(items: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


def _map(values: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "object", "additionalProperties": values}


def _number(node: types.IntType | types.FloatType) -> dict[str, Any]:
    name = "integer" if isinstance(node, types.IntType) else "number"
    limits = {"exclusiveMinimum": node.gt, "minimum": node.ge, "maximum": node.le}
    near = {key: value for key, value in limits.items() if value is not None and abs(value) < 1e18}
    return {"type": name, **near}
