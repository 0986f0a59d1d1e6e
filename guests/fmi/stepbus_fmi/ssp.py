"""Systems of FMUs (System Structure and Parameterization, SSP 1.0 and 2.0) as scenarios.

A system is flattened: each component is a participant, and a connection goes from the variable of
one FMU to that of another, through as many connectors of systems as there are in between.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from stepbus_schemas import WiringError, suggest

from .files import participant, port_of, scenario, scenario_name
from .model import Model, Variable, read_model
from .ssp_files import (
    Archive,
    Signal,
    Transform,
    children,
    parameters,
    read_units,
    required,
    tag,
    transform,
    value_of,
)
from .units import Units

Node = tuple[str, ...]
"""Connector: the names of the elements that lead to it, and its own."""

_INWARD = ("input", "parameter", "structuralParameter")
_EITHER = ("inout", "unspecified")
_PACKAGES = ("application/x-ssp-package", "application/x-ssp-definition")


def system_scenario(path: Path) -> dict[str, Any]:
    """Return the scenario of an SSP, as plain data.

    Raises WiringError for one that cannot run, with the file and the element.
    """
    archive = Archive(path)
    root = archive.xml("SystemStructure.ssd", "SystemStructureDescription")
    system = _System()
    system.read_structure(archive, root, ())
    if not system.parts:
        raise WiringError(f"{archive.of}the system has no component")
    experiment: Any = next(children(root, "DefaultExperiment"), {})
    start, stop = (
        None if (text := experiment.get(key)) is None else value_of("Real", text, key)
        for key in ("startTime", "stopTime")
    )
    system.connect()
    for part in system.parts.values():
        part.row["params"]["start_time"] = start or 0.0
    rows = {part.name: part.row for part in system.parts.values()}
    models = [part.model for part in system.parts.values()]
    span = None if stop is None else stop - (start or 0.0)
    return scenario(scenario_name(root.get("name") or path.stem), rows, models, stop_s=span)


@dataclass
class _Part:
    """A component. row: its participant."""

    path: Node
    name: str
    model: Model
    units: Units
    row: dict[str, Any]


class _Connector(NamedTuple):
    """A connector as the SSP has it. items: of its enumeration, name → number.

    Of a component, the FMU itself knows better; the unit counts where that has none.
    """

    kind: str
    unit: str
    units: Units
    items: Mapping[str, int]


class _Leg(NamedTuple):
    """A connection into a connector. text: what it is in messages."""

    source: Node
    by: Transform
    text: str


class _System:
    """The components, connectors, connections and parameters of an SSP."""

    def __init__(self) -> None:
        self.parts: dict[Node, _Part] = {}
        self._children: dict[Node, list[str]] = {}
        self._connectors: dict[Node, _Connector] = {}
        self._into: dict[Node, _Leg] = {}
        self._values: dict[Node, tuple[Signal, Transform]] = {}

    def read_structure(self, archive: Archive, root: Any, path: Node) -> None:
        """Read a system description; path: of the element that it is, for an SSP in an SSP."""
        for element in children(root, "System"):
            self._read_system(archive, root, element, path)

    def _read_system(self, archive: Archive, root: Any, element: Any, path: Node) -> None:
        names, what = self._children.setdefault(path, []), f"{archive.of}{_words(path)}"
        self._read_connectors(archive, root, element, path)
        for item in children(element, "Elements/*"):
            name = required(item, "name", what)
            if name in names:
                raise WiringError(f"{what} has two elements with the name {name!r}")
            names.append(name)
            self._read_element(archive, root, item, (*path, name))
        for item in children(element, "Connections/Connection"):
            self._read_connection(archive, item, path)
        self._read_values(archive, element, path)

    def _read_connectors(self, archive: Archive, root: Any, element: Any, path: Node) -> None:
        units, what = read_units(root), f"{archive.of}{_words(path)}"
        for item in children(element, "Connectors/Connector"):
            typed: Any = next(iter(item), {})
            items = _items(root, typed.get("name"))
            kind = item.get("kind", "unspecified")
            said = _Connector(kind, typed.get("unit") or "", units, items)
            self._connectors[(*path, required(item, "name", what))] = said

    def _read_element(self, archive: Archive, root: Any, element: Any, path: Node) -> None:
        what, source = _words(path), element.get("source")
        if tag(element) == "System":
            self._read_system(archive, root, element, path)
            return
        if tag(element) != "Component":
            raise WiringError(f"{archive.of}{what} is a {tag(element)}, which is not supported")
        if not source:
            raise WiringError(f"{archive.of}{what} has no source, so that it cannot run")
        if source.endswith(".ssp") or element.get("type") in _PACKAGES:
            inner = Archive(archive.path, archive.place(source, what))
            described = inner.xml("SystemStructure.ssd", "SystemStructureDescription", what)
            self.read_structure(inner, described, path)
        else:
            self._read_connectors(archive, root, element, path)
            self._read_component(archive, element, path, archive.place(source, what))
        self._read_values(archive, element, path)

    def _read_component(self, archive: Archive, element: Any, path: Node, place: str) -> None:
        what, name = f"{archive.of}{_words(path)}", scenario_name("_".join(path))
        if (wanted := element.get("implementation", "any")) not in ("any", "CoSimulation"):
            raise WiringError(f"{what} wants {wanted}, and stepbus has only co-simulation")
        if name in [part.name for part in self.parts.values()]:
            raise WiringError(f"{what} would be a second participant with the name {name!r}")
        try:
            model = read_model(archive.path, place)
        except WiringError as exc:
            raise WiringError(f"{what}: {exc}") from exc
        row = participant(model, archive.path.name, place)
        row["params"] |= {"by_name": False, "start": {}, "inputs": {}}
        row["inputs"] = {}
        self.parts[path] = _Part(path, name, model, Units(model.description), row)

    def _read_values(self, archive: Archive, element: Any, path: Node) -> None:
        """Read parameter bindings; those of a system come after those of what is in it."""
        what = _words(path)
        for binding in children(element, "ParameterBindings/ParameterBinding"):
            for name, value, by in parameters(archive, binding, what):
                self._values |= dict.fromkeys(self._named(path, name), (value, by))

    def _named(self, path: Node, name: str) -> Iterator[Node]:
        """Yield the variables and connectors that have a name in an element, if there are any."""
        part = self.parts.get(path)
        if _has(part.model, name) if part else (*path, name) in self._connectors:
            yield (*path, name)
        for child in self._children.get(path, ()):
            if name.startswith(f"{child}."):
                yield from self._named((*path, child), name.removeprefix(f"{child}."))

    def _read_connection(self, archive: Archive, element: Any, path: Node) -> None:
        owners = [element.get(f"{end}Element") for end in ("start", "end")]
        names = [element.get(f"{end}Connector", "") for end in ("start", "end")]
        ends = [(*path, *([o] if o else []), n) for o, n in zip(owners, names, strict=True)]
        text = f"{archive.of}connection {' → '.join(map('.'.join, ends))}"
        if element.get("startIndices") or element.get("endIndices"):
            raise WiringError(f"{text} is of some places of an array, which is not supported")
        kinds = [self._kind(node, text) for node in ends]
        # Data goes from the inside of an inward connector of this system, and from an outward one
        # of its elements, whichever of both is called start.
        first, last = (
            None if kind in _EITHER else (kind in _INWARD) is not bool(owner)
            for kind, owner in zip(kinds, owners, strict=True)
        )
        if first == last and first is not None:
            raise WiringError(f"{text} joins two {'sources' if first else 'targets'}: {kinds}")
        source, target = ends if first or last is False or first is last else ends[::-1]
        if target in self._into:
            raise WiringError(f"{text} is a second source; there is {self._into[target].text}")
        self._into[target] = _Leg(source, transform(element, text), text)

    def _kind(self, node: Node, text: str) -> str:
        """Return the kind of a connector; raises WiringError where there is none."""
        part = self.parts.get(node[:-1])
        if part is not None and _has(part.model, node[-1]):
            return _variable(part.model, node[-1]).causality
        if part is None and node in self._connectors:
            return self._connectors[node].kind
        known = (
            part.model.places if part else [n[-1] for n in self._connectors if n[:-1] == node[:-1]]
        )
        raise WiringError(
            f"{text}: {_words(node[:-1])} has no {node[-1]!r}{suggest(node[-1], known)}"
        )

    def connect(self) -> None:
        """Write start values and inputs of all components into their participants."""
        for node in dict.fromkeys((*self._values, *self._into)):
            if (part := self.parts.get(node[:-1])) is None:
                continue
            target, leg = _variable(part.model, node[-1]), self._into.get(node)
            try:
                wire, start = self._flow(node, ())
                # An input has its own start value until the first value reaches it.
                if start is not None and not (start.origin and target.causality == "input"):
                    part.row["params"]["start"][node[-1]] = _fitting(start.value, target)
                if wire is not None:
                    self._wire(part, target, node[-1], wire)
            except WiringError as exc:
                raise WiringError(f"{leg.text if leg else '.'.join(node)}: {exc}") from exc

    def _flow(self, node: Node, above: tuple[Node, ...]) -> tuple[Signal | None, Signal | None]:
        """Return what reaches a connector, and its start value, both in its unit."""
        if node in above:
            raise WiringError("connectors of systems are connected in a circle")
        wire = start = None
        unit, units, items = self._known(node)
        if node in self._values:
            value, by = self._values[node]
            start = value.through(by, unit, units)
        if (leg := self._into.get(node)) is not None:
            before = self._known(leg.source)[2]
            wire, begins = (
                signal and signal.through(leg.by, unit, units, (before, items))
                for signal in self._flow(leg.source, (*above, node))
            )
            if begins is not None and not (begins.origin and start):
                start = begins
        elif (part := self.parts.get(node[:-1])) is not None and above:
            wire = Signal(node, unit, units)
            item = _variable(part.model, node[-1])
            if start is not None:
                start = replace(start, origin=node)
            elif item.initial == "exact" and item.start and not item.shape:
                kind = "Integer" if item.kind is int else item.type_name
                start = Signal(node, unit, units, value_of(kind, item.start, item.name))
        return wire, start

    def _known(self, node: Node) -> tuple[str, Units, Mapping[str, int]]:
        """Return the unit of a connector, who knows it, and the items of its enumeration."""
        part, said = self.parts.get(node[:-1]), self._connectors.get(node)
        if part is None and said is not None:
            return said[1:]
        assert part is not None  # noqa: S101  a node is a connector or a variable
        item = _variable(part.model, node[-1])
        unit = (item.unit, part.units) if item.unit or said is None else (said.unit, said.units)
        return *unit, dict(item.items)

    def _wire(self, part: _Part, target: Variable, name: str, wire: Signal) -> None:
        """Connect an input with a variable of another component."""
        source = self.parts[wire.origin[:-1]]
        item = _variable(source.model, wire.origin[-1])
        if target.causality != "input":
            if name in part.row["params"]["start"]:
                return
            of = f"{target.name} is a {target.causality}, and {source.name}.{item.name} is computed"
            raise WiringError(f"{of} in the run; give its value by a parameter binding")
        if source is part:
            raise WiringError("an element is connected with itself, which is not supported")
        if item.kind is not target.kind and (item.kind, target.kind) != (int, float):
            raise WiringError(f"{item.type_name} is connected with {target.type_name}")
        if item.causality != "output":
            published = source.row["params"].setdefault("publish", [])
            published += [] if item.name in published else [item.name]
        output, type_ = port_of(item.kind)
        source.row["outputs"].setdefault(output, type_)
        port = source.name + output.removeprefix("out")
        place = f"{source.name}.{output}"
        if part.row["inputs"].setdefault(port, place) != place:
            raise WiringError(f"two input ports of {part.name} would have the name {port!r}")
        link = {"from": f"{port}.{wire.origin[-1]}", "convert": False}
        if wire.scale != (1.0, 0.0):
            link |= {"factor": wire.scale[0], "offset": wire.scale[1]}
        if wire.table:
            link["table"] = [list(pair) for pair in wire.table.items()]
        part.row["params"]["inputs"][name] = link["from"] if wire.is_same else link


def _words(path: Node) -> str:
    return f"element {'.'.join(path)}" if path else "the system"


def _has(model: Model, name: str) -> bool:
    return name in model.variables or name in model.places


def _variable(model: Model, name: str) -> Variable:
    return model.variables[name] if name in model.variables else model.places[name][0]


def _items(root: Any, name: str | None) -> dict[str, int]:
    """Return the items of an enumeration that a file defines."""
    found = [e for e in children(root, "Enumerations/Enumeration") if e.get("name") == name]
    what = f"an item of the enumeration {name}"
    return {
        required(item, "name", what): value_of("Integer", required(item, "value", what), what)
        for one in found
        for item in children(one, "Item")
    }


def _fitting(value: Any, target: Variable) -> Any:
    """Return a value for a variable: a whole number for an integer."""
    whole = isinstance(value, float) and value.is_integer() and target.kind is int
    return int(value) if whole else value
