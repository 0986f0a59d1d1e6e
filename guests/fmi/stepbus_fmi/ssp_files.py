"""What is in an SSP: its files, and the units, values and transformations in them."""

import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import unquote

from stepbus_participant import need
from stepbus_schemas import WiringError, error_text

from .model import KINDS, open_fmu
from .units import Units

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")
_LARGEST = 64 << 20
_KINDS = {**KINDS, "Enumeration": str, "Binary": str}


def required(element: Any, key: str, what: str) -> str:
    """Return an attribute of an XML element; raises WiringError where there is none."""
    if not (text := element.get(key)):
        raise WiringError(f"{what}: a {tag(element)} has no {key!r}")
    return str(text)


def children(element: Any, path: str) -> Iterator[Any]:
    """Return what is below an XML element, such as `Connectors/Connector`, of any namespace."""
    found: Iterator[Any] = element.iterfind("/".join(f"{{*}}{tag}" for tag in path.split("/")))
    return found


def tag(element: Any) -> str:
    """Return the name of an XML element without its namespace, in which SSP 1.0 and 2.0 agree."""
    return str(element.tag).rpartition("}")[2]


class Archive:
    """An SSP, or one inside it, which messages name by `of`. Its methods raise WiringError."""

    def __init__(self, path: Path, inside: str = "") -> None:
        self.path, self._inside = path, inside
        self.of = f"{inside.removeprefix('/')}: " if inside else ""
        (self._etree,) = need("an SSP", "lxml.etree")
        try:
            with zipfile.ZipFile(open_fmu(path, inside)) as archive:
                self._sizes = {item.filename: item.file_size for item in archive.infolist()}
        except (OSError, zipfile.BadZipFile) as exc:
            raise WiringError(f"{self.of}no SSP: {error_text(exc)}") from exc

    def place(self, source: str, what: str) -> str:
        """Return where a file is that an element names by a relative URI, as `open_fmu` takes it.

        what: the element, for messages.
        """
        name = unquote(source).removeprefix("./")
        if name not in self._sizes:
            raise WiringError(f"{self.of}{what} needs {source!r}, which is not in the archive")
        # Absolute, so that it is not taken for a file beside the scenario.
        return f"{self._inside}!/{name}" if self._inside else f"/{name}"

    def xml(self, name: str, root: str, what: str = "an SSP") -> Any:
        """Return the root of an XML file."""
        name = self.place(name, what).rpartition("!")[2].removeprefix("/")
        if self._sizes[name] > _LARGEST:
            raise WiringError(f"{self.of}{name} has more than {_LARGEST >> 20} MB")
        # Nothing outside of the file is read, and no entity is expanded.
        parser = self._etree.XMLParser(
            resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True
        )
        try:
            with zipfile.ZipFile(open_fmu(self.path, self._inside)) as archive:
                read = self._etree.fromstring(archive.read(name), parser)
        except Exception as exc:  # zipfile raises what its decoders do
            raise WiringError(f"{self.of}{name} cannot be read: {error_text(exc)}") from exc
        if read.getroottree().docinfo.doctype:
            raise WiringError(f"{self.of}{name} has a DOCTYPE, which SSP does not allow")
        if tag(read) != root:
            raise WiringError(f"{self.of}{name} is a {tag(read)}, not a {root}")
        return read


def read_units(root: Any) -> Units:
    """Return the units that a file defines."""
    made = []
    for unit in children(root, "Units/Unit"):
        name, base = unit.get("name"), next(children(unit, "BaseUnit"), None)
        row = None
        if base is not None:
            texts = {**dict.fromkeys((*_BASES, "offset"), "0"), "factor": "1", **base.attrib}
            row = {key: value_of("Real", text, f"unit {name}") for key, text in texts.items()}
            if not row["factor"]:
                raise WiringError(f"unit {name} has the factor 0")
            row = SimpleNamespace(**row)
        made.append(SimpleNamespace(name=name, baseUnit=row, displayUnits=()))
    return Units(SimpleNamespace(unitDefinitions=made))


@dataclass(frozen=True)
class Transform:
    """What happens to a value on its way. table: of a mapping, source → target, as texts."""

    convert: bool = True
    scale: tuple[float, float] = (1.0, 0.0)
    kind: str = ""
    table: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Signal:
    """A value on its way: of an element, or constant.

    origin: path and name of the variable; nothing: constant. unit: in the words of `units`.
    is_same: whether it has not been changed.
    """

    origin: tuple[str, ...]
    unit: str
    units: Units
    constant: Any = None
    scale: tuple[float, float] = (1.0, 0.0)
    table: Mapping[Any, Any] = field(default_factory=dict)
    is_same: bool = True

    def through(
        self,
        by: Transform,
        unit: str,
        units: Units,
        items: tuple[Mapping[str, int], Mapping[str, int]] = ({}, {}),
    ) -> "Signal":
        """Return it behind a transformation, in a unit, or in its own if there is none.

        items: of the enumerations before and behind, name → number. Raises WiringError.
        """
        factor, offset = self.units.conversion(self.unit, unit, units) if by.convert else (1.0, 0.0)
        factor, offset = by.scale[0] * factor, by.scale[0] * offset + by.scale[1]
        first = {self._read(by.kind, s, items[0]): self._read(by.kind, t, items[1])
                 for s, t in by.table.items()}  # fmt: skip
        return replace(
            self,
            unit=unit or self.unit,
            units=units if unit else self.units,
            scale=(factor * self.scale[0], factor * self.scale[1] + offset),
            table={**first, **{s: first.get(t, t) for s, t in self.table.items()}},
            is_same=self.is_same
            and by == Transform()
            and (unit == self.unit or not unit or not self.unit),
        )

    def _read(self, kind: str, text: str, items: Mapping[str, int]) -> Any:
        if kind != "Enumeration":
            return value_of(kind, text, "a mapping")
        if self.origin and text not in items:
            raise WiringError(f"the enumeration of the connector has no item {text!r}")
        return items[text] if self.origin else text

    @property
    def value(self) -> Any:
        """Return the value of a constant."""
        if isinstance(self.constant, list):
            return [replace(self, constant=item).value for item in self.constant]
        if isinstance(self.constant, float) and self.scale != (1.0, 0.0):
            return self.constant * self.scale[0] + self.scale[1]
        return self.table.get(self.constant, self.constant) if self.table else self.constant


def value_of(kind: str, text: str, what: str) -> Any:
    """Return a value that a file has as text. kind: as the standard names it."""
    made = _KINDS[kind]
    try:
        if made is bool:
            return {"true": True, "1": True, "false": False, "0": False}[text.strip()]
        return made(text)
    except (KeyError, ValueError) as exc:
        raise WiringError(f"{what} has the {kind} {text!r}") from exc


def transform(element: Any, what: str) -> Transform:
    """Return the transformation of a connection or of an entry of a mapping."""
    convert = element.get("suppressUnitConversion") not in ("true", "1")
    for item in element:
        kind = tag(item).removesuffix("Transformation")
        if kind == "Linear":
            texts = item.get("factor", "1"), item.get("offset", "0")
            factor, offset = (value_of("Real", text, what) for text in texts)
            return Transform(convert, (factor, offset))
        if kind in ("BooleanMapping", "IntegerMapping", "EnumerationMapping"):
            rows = [(required(row, "source", what), required(row, "target", what))
                    for row in children(item, "MapEntry")]  # fmt: skip
            table = dict(rows)
            return Transform(convert, kind=kind.removesuffix("Mapping"), table=table)
    return Transform(convert)


def parameters(
    archive: Archive, binding: Any, what: str
) -> Iterator[tuple[str, Signal, Transform]]:
    """Yield name, value and transformation of the parameters of a binding."""
    found = _content(archive, binding, "ParameterSet", f"a parameter binding of {what}")
    units, prefix = read_units(found), binding.get("prefix", "")
    values = {}
    for item in children(found, "Parameters/Parameter"):
        name = prefix + required(item, "name", f"{archive.of}{what}")
        values[name] = _constant(item, units, f"{archive.of}parameter {name} of {what}")
    mapping = next(children(binding, "ParameterMapping"), None)
    if mapping is None:
        yield from ((name, value, Transform()) for name, value in values.items())
        return
    of = f"the parameter mapping of {what}"
    for entry in children(_content(archive, mapping, "ParameterMapping", of), "MappingEntry"):
        target = required(entry, "target", f"{archive.of}{of}")
        if (value := values.get(entry.get("source"))) is not None:
            yield target, value, transform(entry, f"{archive.of}{of}")


def _content(archive: Archive, element: Any, root: str, what: str) -> Any:
    """Return what an element has in it, or in the file that it names."""
    if element.get("sourceBase", "SSD") != "SSD":
        raise WiringError(f"{archive.of}{what} is in its component, which is not supported")
    if element.get("source"):
        return archive.xml(element.get("source"), root, what)
    inline = next((e for e in element.iterfind(f".//{{*}}{root}") if e is not element), None)
    if inline is None:
        raise WiringError(f"{archive.of}{what} has no {root}")
    return inline


def _constant(item: Any, units: Units, what: str) -> Signal:
    typed = next((child for child in item if tag(child) in _KINDS), None)
    if typed is None:
        raise WiringError(f"{what} has no value of a known type")
    kind, text = tag(typed), typed.get("value", "")
    texts = [child.get("value", "") for child in children(typed, "Value")]
    is_array = len(texts) > 1 or next(children(item, "Dimension"), None) is not None
    if not texts:
        texts = text.split() if is_array and _KINDS[kind] is not str else [text]
    values = [value_of(kind, text, what) for text in texts]
    return Signal((), typed.get("unit", ""), units, values if is_array else values[0])
