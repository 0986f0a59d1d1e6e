"""What a declaration says about each key, as text and as tables in Markdown."""

import ast
import inspect
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from msgspec import inspect as types

from stepbus_participant import PerName, Settings, format_duration
from stepbus_participant.parameters import (
    conditions,
    default,
    is_own,
    listed,
    mark,
    options_of,
    plain,
)

_HEAD = "| Key | Value | Default | Meaning |\n|---|---|---|---|\n"
_DEFAULT = re.compile(r"\s*Default: (.+?)\.?$", re.DOTALL)
_MARKED = {
    "duration": "duration",
    "pause": "duration, or `0s`",
    "name": "name",
    "file": "file",
    "model": "file",
    "names": "list of names",
    "plugin": "`module:Class`",
}


@dataclass(frozen=True, kw_only=True)
class Row:
    """A key: its form, its default, and what it means."""

    key: str
    value: str
    default: str
    meaning: str


def rows_of(settings: type[Settings]) -> list[Row]:
    """Return a row for each key."""
    texts = descriptions(settings)
    return [_row(field, texts.get(field.name, "")) for field in fields_of(settings)]


def fields_of(settings: type[Settings]) -> list[types.Field]:
    """Return the fields that are keys, in the order of their declaration."""
    info = types.type_info(settings)
    return [field for field in getattr(info, "fields", ()) if not is_own(field)]


def parts_of(settings: type[Settings]) -> Iterator[tuple[str, type[Settings]]]:
    """Yield the settings below these, with the keys that lead to them: `stock.types.*`."""
    for field in fields_of(settings):
        for path, part in _parts(field.type, field.encode_name):
            yield path, part
            for below, inner in parts_of(part):
                yield f"{path}.{below}", inner


def settings_of(node: types.StructType) -> type[Settings]:
    """Return the class of a map's type."""
    if not issubclass(node.cls, Settings):
        raise TypeError(f"{node.cls} is declared without Settings")
    return node.cls


def _parts(node: types.Type, path: str) -> Iterator[tuple[str, type[Settings]]]:
    for option in options_of(node):
        bare = plain(option)
        if isinstance(bare, types.StructType):
            yield path, settings_of(bare)
        elif isinstance(bare, types.DictType):
            yield from _parts(bare.value_type, f"{path}.*")
        elif isinstance(bare, types.VarTupleType):
            yield from _parts(bare.item_type, f"{path}[]")


@cache
def descriptions(settings: type[Settings]) -> Mapping[str, str]:
    """Return field → the text below it in the source."""
    texts: dict[str, str] = {}
    for cls in reversed(settings.__mro__):
        if cls.__module__.startswith(("builtins", "msgspec")):
            continue
        tree = ast.parse(inspect.getsource(sys.modules[cls.__module__]))
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and node.name == cls.__name__:
                texts |= _texts(node)
    return texts


def _texts(node: ast.ClassDef) -> dict[str, str]:
    """Return the texts that stand below annotated names."""
    texts = {}
    for field, text in zip(node.body, node.body[1:], strict=False):
        if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
            continue
        value = text.value if isinstance(text, ast.Expr) else None
        if isinstance(value, ast.Constant) and isinstance(value.value, str):
            texts[field.target.id] = " ".join(inspect.cleandoc(value.value).split())
    return texts


def _row(field: types.Field, text: str) -> Row:
    stated = _DEFAULT.search(text)
    meaning = text[: stated.start()] if stated else text
    shown = "required" if field.required else show_default(field)
    return Row(
        key=field.encode_name,
        value=form(field.type),
        default=stated[1] if stated else shown,
        meaning=_with_condition(field, meaning),
    )


def _with_condition(field: types.Field, meaning: str) -> str:
    wanted = " and ".join(f"`{key}: {listed(values)}`" for key, values in conditions(field).items())
    return f"With {wanted}. {meaning}" if wanted else meaning


def show_default(field: types.Field) -> str:
    """Return the default of a field as a scenario has it."""
    value: Any = default(field)
    if isinstance(value, PerName):
        value = repr(value).removeprefix("each(").removesuffix(")")
    if is_duration(field.type) and value is not None:
        return format_duration(value) if value else "0s"
    if value in (None, (), {}, "") or isinstance(value, Settings):
        return "none"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return f"[{', '.join(f'{item:g}' if isinstance(item, float) else item for item in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def is_duration(node: types.Type) -> bool:
    """Return whether a type is a duration, in [ns]."""
    return any(mark(item) in ("duration", "pause") for item in (node, *options_of(node)))


def form(node: types.Type) -> str:
    """Return what a value looks like: `number > 0`, `list of text`."""
    text = mark(node)
    if text in _MARKED:
        return _MARKED[text]
    if text == "per_name":
        extra = node.extra if isinstance(node, types.Metadata) else None
        item = types.type_info((extra or {})["item"])
        return f"{form(item)}; one for all joints, a list, or a map by joint"
    options = options_of(node)
    if options == [plain(node)]:
        return _form(options[0])
    return " or ".join(dict.fromkeys(form(option) for option in options))


def _form(node: types.Type) -> str:
    match node:
        case types.LiteralType():
            text = ", ".join(f"`{value}`" for value in node.values)
        case types.IntType() | types.FloatType():
            text = _number(node)
        case types.BoolType():
            text = "`true`, `false`"
        case types.StrType():
            text = "text"
        case types.DictType():
            text = f"map: name → {form(node.value_type)}"
        case types.VarTupleType():
            text = f"list of {form(node.item_type)}"
        case types.TupleType():
            text = f"{len(node.item_types)} numbers"
        case types.StructType():
            text = "text or map" if settings_of(node).short else "map"
        case _:
            text = "any"
    return text


def _number(node: types.IntType | types.FloatType) -> str:
    name = "integer" if isinstance(node, types.IntType) else "number"
    if node.gt is not None:
        return f"{name} > {node.gt:g}"
    least = node.ge if node.ge is not None and abs(node.ge) < 1e18 else None
    most = node.le if node.le is not None and abs(node.le) < 1e18 else None
    if least is not None and most is not None:
        return f"{name}, {least:g} to {most:g}"
    return name if least is None else f"{name} ≥ {least:g}"


def table(settings: type[Settings]) -> str:
    """Return the keys as a table."""
    return _HEAD + "".join(map(_line, rows_of(settings)))


def tables(settings: type[Settings]) -> str:
    """Return the keys as a table, followed by one for each map below."""
    parts: dict[type[Settings], str] = {}
    for path, part in parts_of(settings):
        parts.setdefault(part, path)
    texts = [f"\n`{path}`: {_summary(part)}\n\n{table(part)}" for part, path in parts.items()]
    return table(settings) + "".join(texts)


def _summary(settings: type[Settings]) -> str:
    text = inspect.cleandoc(settings.__doc__ or "").partition("\n\n")[0]
    return " ".join(text.split())


def _line(row: Row) -> str:
    cells = (f"`{row.key}`", row.value, row.default, row.meaning)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |\n"
