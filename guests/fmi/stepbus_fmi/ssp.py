"""Systems of FMUs (System Structure and Parameterization, SSP 1.0 and 2.0) as scenarios.

A system is flattened: each component is a participant, and a connection goes from the variable of
one FMU to that of another, through as many connectors of systems as there are in between.
"""

import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple
from urllib.parse import unquote

from stepbus_participant import need
from stepbus_schemas import WiringError, error_text, suggest

from .files import PORTS, participant, scenario, scenario_name
from .model import KINDS, Model, Variable, kind_of, read_model
from .units import Units

Node = tuple[str, ...]
"""Connector: the names of the elements that lead to it, and its own."""
Unit = tuple[str, Units]
"""Unit, and what knows it."""
Transform = tuple[bool, tuple[float, float]]
"""What happens to a value on its way: whether its unit is converted, then factor and offset."""

_SAME = (1.0, 0.0)
_INWARD = ("input", "parameter", "structuralParameter")
_KINDS = {**KINDS, "Enumeration": str, "Binary": str}
_NO_UNIT = {**dict.fromkeys(("kg", "m", "s", "A", "K", "mol", "cd", "offset"), "0"), "factor": "1"}


def system_scenario(path: Path) -> dict[str, Any]:
    """Return the scenario of an SSP; raises WiringError, with the element, where it cannot run."""
    try:
        with _Archive(path) as archive:
            root = archive.xml("SystemStructure.ssd", "SystemStructureDescription", "an SSP")
            system = _System(path, archive, root)
    except (OSError, zipfile.BadZipFile) as exc:
        raise WiringError(f"no SSP: {error_text(exc)}") from exc
    if not system.parts:
        raise WiringError("the system has no component")
    experiment: Any = next(root.iterfind("{*}DefaultExperiment"), {})
    start = _value("Real", experiment.get("startTime", "0"), "startTime")
    stop = experiment.get("stopTime")
    system.connect(start)
    rows = {part.name: part.row for part in system.parts.values()}
    models = [part.model for part in system.parts.values()]
    span = None if stop is None else _value("Real", stop, "stopTime") - start
    return scenario(scenario_name(root.get("name") or path.stem), rows, models, stop_s=span)


class _Signal(NamedTuple):
    """A variable, by its node, or else a constant, on its way."""

    unit: Unit
    origin: Node = ()
    constant: Any = None
    scale: tuple[float, float] = _SAME

    def through(self, by: Transform, unit: Unit) -> "_Signal":
        """Return it behind a transformation, in a unit, or in its own if there is none."""
        convert, (times, plus) = by
        factor, offset = self.unit[1].conversion(self.unit[0], *unit) if convert else _SAME
        factor, offset = times * factor, times * offset + plus
        scale = factor * self.scale[0], factor * self.scale[1] + offset
        return self._replace(unit=unit if unit[0] else self.unit, scale=scale)


class _Archive(zipfile.ZipFile):
    """An SSP. Its methods raise WiringError; what: the element that names a file."""

    def place(self, source: str, what: str) -> str:
        """Return the name in the archive of a file of a relative URI."""
        name = unquote(source).removeprefix("./")
        if name not in self.NameToInfo:
            raise WiringError(f"{what} needs {source!r}, which is not in the archive")
        return name

    def xml(self, source: str, root: str, what: str) -> Any:
        """Return the root of an XML file."""
        name = self.place(source, what)
        (etree,) = need("an SSP", "lxml.etree")
        # Nothing outside of the file is read, and no entity is expanded.
        safe = {"resolve_entities": False, "no_network": True}
        parser = etree.XMLParser(remove_comments=True, remove_pis=True, **safe)
        try:
            read = etree.fromstring(self.read(name), parser)
        except Exception as exc:  # zipfile raises what its decoders do
            raise WiringError(f"{name} cannot be read: {error_text(exc)}") from exc
        if read.getroottree().docinfo.doctype:
            raise WiringError(f"{name} has a DOCTYPE, which SSP does not allow")
        if _tag(read) != root:
            raise WiringError(f"{name} is a {_tag(read)}, not a {root}")
        return read

    def parameters(self, binding: Any, what: str) -> Iterator[tuple[str, _Signal, Transform]]:
        """Yield name, value and transformation of the parameters of a binding."""
        found = self._content(binding, "ParameterSet", f"a parameter binding of {what}")
        units, values = _units(found), {}
        for item in found.iterfind("{*}Parameters/{*}Parameter"):
            name = binding.get("prefix", "") + _required(item, "name", what)
            if (typed := item.find("*[@value]")) is None:
                raise WiringError(f"parameter {name} of {what} has no value")
            value = _value(_tag(typed), typed.get("value"), f"parameter {name} of {what}")
            values[name] = _Signal((typed.get("unit", ""), units), constant=value)
        if (mapping := binding.find("{*}ParameterMapping")) is None:
            yield from ((name, value, (True, _SAME)) for name, value in values.items())
            return
        of = f"the parameter mapping of {what}"
        for entry in self._content(mapping, "ParameterMapping", of).iterfind("{*}MappingEntry"):
            target, by = _required(entry, "target", of), _transform(entry, of)
            if (value := values.get(entry.get("source"))) is not None:
                yield target, value, by

    def _content(self, element: Any, root: str, what: str) -> Any:
        """Return what an element has in it, or in the file that it names."""
        if element.get("sourceBase", "SSD") != "SSD":
            raise WiringError(f"{what} is in its component, which is not supported")
        if element.get("source"):
            return self.xml(element.get("source"), root, what)
        if (inline := element.find(f".//{{*}}{root}")) is None:
            raise WiringError(f"{what} has no {root}")
        return inline


class _Leg(NamedTuple):
    """A connection into a connector. text: what it is in messages."""

    source: Node
    by: Transform
    text: str


class _Part(NamedTuple):
    """A component. variables: by name, also by those of the places in them. row: participant."""

    name: str
    model: Model
    variables: Mapping[str, Variable]
    row: dict[str, Any]


class _System:
    """The components, connectors, connections and parameters of an SSP.

    A connector is its kind and unit: of a component, those of the FMU; where that has no unit, the
    one in the SSP counts. Values are by the names of their nodes, with dots.
    """

    def __init__(self, path: Path, archive: _Archive, root: Any) -> None:
        self.parts: dict[Node, _Part] = {}
        self._path, self._archive, self._units = path, archive, _units(root)
        self._connectors: dict[Node, tuple[str, Unit]] = {}
        self._into: dict[Node, _Leg] = {}
        self._values: dict[str, tuple[_Signal, Transform]] = {}
        for element in root.iterfind("{*}System"):
            self._read(element, ())

    def _read(self, element: Any, path: Node) -> None:
        """Read an element; parameters of a system come after those of what is in it."""
        what, kind = _words(path), _tag(element)
        for item in element.iterfind("{*}Connectors/{*}Connector"):
            unit = next((typed.get("unit") for typed in item), None) or ""
            said = item.get("kind", "unspecified"), (unit, self._units)
            self._connectors[(*path, _required(item, "name", what))] = said
        if kind not in ("System", "Component"):
            raise WiringError(f"{what} is a {kind}, which is not supported")
        if kind == "Component":
            self._read_component(element, path, what)
        names = [_required(item, "name", what) for item in element.iterfind("{*}Elements/*")]
        if twice := [name for name in names if names.count(name) > 1]:
            raise WiringError(f"{what} has two elements with the name {twice[0]!r}")
        for item, name in zip(element.iterfind("{*}Elements/*"), names, strict=True):
            self._read(item, (*path, name))
        for item in element.iterfind("{*}Connections/{*}Connection"):
            self._read_connection(item, path)
        for binding in element.iterfind("{*}ParameterBindings/{*}ParameterBinding"):
            for name, value, by in self._archive.parameters(binding, what):
                self._values[".".join((*path, name))] = value, by

    def _read_component(self, element: Any, path: Node, what: str) -> None:
        name, source = scenario_name("_".join(path)), _required(element, "source", what)
        if source.endswith(".ssp") or "x-ssp" in element.get("type", ""):
            raise WiringError(f"{what} is an SSP itself, which is not supported")
        if (wanted := element.get("implementation", "any")) not in ("any", "CoSimulation"):
            raise WiringError(f"{what} wants {wanted}, and stepbus has only co-simulation")
        if name in [part.name for part in self.parts.values()]:
            raise WiringError(f"{what} would be a second participant with the name {name!r}")
        # Absolute, so that it is not taken for a file beside the scenario.
        place = f"/{self._archive.place(source, what)}"
        try:
            model = read_model(self._path, place)
        except WiringError as exc:
            raise WiringError(f"{what}: {exc}") from exc
        row = participant(model, self._path.name, place)
        row["params"] |= {"by_name": False, "start": {}, "inputs": {}}
        row["inputs"] = {}
        variables = {**model.places, **model.variables}
        self.parts[path] = _Part(name, model, variables, row)
        for key, item in variables.items():
            said = self._connectors.get((*path, key))
            unit = (item.unit, model.units) if item.unit or said is None else said[1]
            self._connectors[(*path, key)] = item.causality, unit

    def _read_connection(self, element: Any, path: Node) -> None:
        owners = [element.get(f"{end}Element") for end in ("start", "end")]
        names = [element.get(f"{end}Connector", "") for end in ("start", "end")]
        ends = [(*path, *([o] if o else []), n) for o, n in zip(owners, names, strict=True)]
        text = f"connection {' → '.join(map('.'.join, ends))}"
        if element.get("startIndices") or element.get("endIndices"):
            raise WiringError(f"{text} is of some places of an array, which is not supported")
        for *above, name in [node for node in ends if node not in self._connectors]:
            near = suggest(name, [key[-1] for key in self._connectors if key[:-1] == (*above,)])
            raise WiringError(f"{text}: {_words((*above,))} has no {name!r}{near}")
        kinds = [self._connectors[node][0] for node in ends]
        # Data goes from the inside of an inward connector of this system, and from an outward one
        # of its elements, whichever of both is called start.
        first, last = (
            None if kind in ("inout", "unspecified") else (kind in _INWARD) is not bool(owner)
            for kind, owner in zip(kinds, owners, strict=True)
        )
        if first == last and first is not None:
            raise WiringError(f"{text} joins two {'sources' if first else 'targets'}: {kinds}")
        source, target = ends if first or last is False or first is last else ends[::-1]
        if target in self._into:
            raise WiringError(f"{text} is a second source; there is {self._into[target].text}")
        self._into[target] = _Leg(source, _transform(element, text), text)

    def connect(self, start_s: float) -> None:
        """Write start time, start values and inputs of all components into their participants."""
        for path, part in self.parts.items():
            params = part.row["params"]
            params["start_time"] = start_s
            for name, item in part.variables.items():
                node = (*path, name)
                try:
                    wire, start = self._flow(node, ())
                    if start is not None:
                        params["start"][name] = _start(start, item)
                    if wire is not None and not (start and item.causality != "input"):
                        params["inputs"][name] = self._link(part, item, wire)
                except (WiringError, ZeroDivisionError) as exc:
                    of = self._into[node].text if node in self._into else ".".join(node)
                    raise WiringError(f"{of}: {exc}") from exc

    def _flow(self, node: Node, above: tuple[Node, ...]) -> tuple[_Signal | None, _Signal | None]:
        """Return what reaches a connector, and its start value, both in its unit."""
        if node in above:
            raise WiringError("connectors of systems are connected in a circle")
        unit, wire, start = self._connectors[node][1], None, None
        if above and node[:-1] in self.parts:
            return _Signal(unit, node), None
        if (own := self._values.get(".".join(node))) is not None:
            start = own[0].through(own[1], unit)
        if (leg := self._into.get(node)) is not None:
            wire, begins = self._flow(leg.source, (*above, node))
            wire = wire and wire.through(leg.by, unit)
            start = begins.through(leg.by, unit) if begins else start
        return wire, start

    def _link(self, part: _Part, target: Variable, wire: _Signal) -> dict[str, Any]:
        """Return the link of an input to a variable of another component; makes its port."""
        source = self.parts[wire.origin[:-1]]
        item = source.variables[wire.origin[-1]]
        if target.causality != "input":
            of = f"{target.name} is a {target.causality}, and {source.name}.{item.name} is computed"
            raise WiringError(f"{of} in the run; give its value by a parameter binding")
        if source is part:
            raise WiringError("an element is connected with itself, which is not supported")
        kind = kind_of(item)
        if kind_of(target) not in (kind, float if kind is int else kind):
            raise WiringError(f"{item.type} is connected with {target.type}")
        if item.causality != "output":
            published = source.row["params"].setdefault("publish", [])
            published += [] if item.name in published else [item.name]
        output, type_ = next((port, type_) for port, of, type_ in PORTS if of is kind)
        source.row["outputs"].setdefault(output, type_)
        port, place = source.name + output.removeprefix("out"), f"{source.name}.{output}"
        if part.row["inputs"].setdefault(port, place) != place:
            raise WiringError(f"two input ports of {part.name} would have the name {port!r}")
        link = {"from": f"{port}.{wire.origin[-1]}", "convert": False}
        scale = {"factor": wire.scale[0], "offset": wire.scale[1]}
        return link if wire.scale == _SAME else link | scale


def _words(path: Node) -> str:
    return f"element {'.'.join(path)}" if path else "the system"


def _tag(element: Any) -> str:
    """Return the name of an XML element without its namespace, in which SSP 1.0 and 2.0 agree."""
    return str(element.tag).rpartition("}")[2]


def _required(element: Any, key: str, what: str) -> str:
    if not (text := element.get(key)):
        raise WiringError(f"{what}: a {_tag(element)} has no {key!r}")
    return str(text)


def _value(kind: str, text: str, what: str) -> Any:
    """Return a value that a file has as text. kind: as the standard names it."""
    try:
        if kind == "Boolean":
            return {"true": True, "1": True, "false": False, "0": False}[text.strip()]
        return _KINDS[kind](text)
    except (KeyError, ValueError) as exc:
        raise WiringError(f"{what} has the {kind} {text!r}") from exc


def _start(signal: _Signal, target: Variable) -> Any:
    """Return the start value that a constant gives a variable."""
    value = signal.constant
    if signal.scale != _SAME and type(value) in (int, float):
        value = value * signal.scale[0] + signal.scale[1]
    whole = isinstance(value, float) and value.is_integer() and kind_of(target) is int
    return int(value) if whole else value


def _units(root: Any) -> Units:
    """Return the units that a file defines."""
    made = []
    for base in root.iterfind("{*}Units/{*}Unit/{*}BaseUnit"):
        name, texts = base.getparent().get("name"), {**_NO_UNIT, **base.attrib}
        row = {key: _value("Real", text, f"unit {name}") for key, text in texts.items()}
        made.append(SimpleNamespace(name=name, baseUnit=SimpleNamespace(**row), displayUnits=()))
    return Units(made, "SSP")


def _transform(element: Any, what: str) -> Transform:
    """Return the transformation of a connection or of an entry of a mapping."""
    for name in map(_tag, element):
        if name.endswith("MappingTransformation"):
            raise WiringError(f"{what} has a {name}, which is not supported")
    item: Any = next(element.iterfind("{*}LinearTransformation"), {})
    factor = _value("Real", item.get("factor", "1"), what)
    offset = _value("Real", item.get("offset", "0"), what)
    convert = element.get("suppressUnitConversion") not in ("true", "1")
    return convert, (factor, offset)
