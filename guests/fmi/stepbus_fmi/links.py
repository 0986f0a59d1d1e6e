"""Which value of which message an input variable gets."""

import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from stepbus_participant import Config, Problems
from stepbus_schemas import Description, Message, Row, WiringError, fields_of, suggest
from stepbus_schemas.declaration import class_declaration

from .model import Model, Variable, kind_of, names_of
from .params import Link, Params

_ELEMENT = re.compile(r"(.+)\[([^\[\]]+)\]")


@dataclass(frozen=True)
class Wire:
    """One value on its way: port, field and places in it → target, a name of the variable's.

    scale: factor and offset.
    """

    port: str
    field: str
    places: tuple[int, ...]
    variable: Variable
    target: str
    scale: tuple[float, float]

    def value(self, message: Any) -> Any:
        """Return the value that the variable gets; raises IndexError for a vector too short."""
        value = getattr(message, self.field)
        for place in self.places:
            value = value[place]
        if isinstance(value, bool) and (kind := kind_of(self.variable)) in (int, float):
            value = kind(value)  # 0 or 1, as other tools do
        # Not 1 · value + 0, which turns −0 into 0.
        return value if self.scale == (1.0, 0.0) else value * self.scale[0] + self.scale[1]


def ends_of(model: Model, ports: Iterable[str], name: str, link: Link) -> tuple[Variable, str, str]:
    """Return the variable of a link, the input port, and what of that; raises WiringError."""
    item = model.places.get(name) or model.find(name)
    if item.causality != "input":
        raise WiringError(f"{name} is no input of the FMU: its causality is {item.causality}")
    port, _, what = link.from_.partition(".")
    if port not in ports or not what:
        text = f"{link.from_!r} names no input port; write PORT.NAME"
        raise WiringError(text + suggest(port, ports))
    return item, port, what


class _Port:
    """What can be had of an input port.

    fields: of its messages. names: of the values of its only field, `vector`; none where it has
    more fields.
    """

    def __init__(self, name: str, cls: type[Message], described: Description) -> None:
        self.fields: Mapping[str, Row] = {}
        with suppress(WiringError):  # of parts that no declaration can say
            self.fields = fields_of(class_declaration(cls))
        vectors = [name for name, row in self.fields.items() if str(row["type"]).endswith("[n]")]
        self.vector = vectors[0] if len(vectors) == len(self.fields) == 1 else ""
        self.names = described.names if self.vector else []
        self.offers = self.names or list(self.fields)
        self._name, self._described = name, described

    def find(self, what: str) -> tuple[str, tuple[int, ...], str]:
        """Return field, places and unit of a value; raises WiringError where there is none."""
        described = self._described
        if what in self.names:
            index = self.names.index(what)
            units = described.details.get("unit", [])
            unit = units[index] if units else self.fields[self.vector].get("unit", "")
            return self.vector, (index,), unit
        match = _ELEMENT.fullmatch(what)
        field, inner = (match[1], match[2].split(",")) if match else (what, [])
        if field not in self.fields:
            raise WiringError(f"port {self._name!r} has no {what!r}{suggest(what, self.offers)}")
        places = tuple(_place(described.names, text.strip()) for text in inner)
        return field, places, described.units.get(field) or self.fields[field].get("unit", "")


def _place(names: list[str], text: str) -> int:
    if text in names:
        return names.index(text)
    if text.isdigit():
        return int(text)
    raise WiringError(f"{text!r} is no place of a vector{suggest(text, names)}")


def wires(
    model: Model,
    config: Config,
    descriptions: Mapping[str, Description],
    params: Params,
    problems: Problems,
) -> dict[str, list[Wire]]:
    """Return the wires of the inputs by port; adds what is wrong, such as a port without any.

    descriptions: of the sources, by port.
    """
    ports = {
        port: _Port(port, config.types[item.type], descriptions.get(port, Description()))
        for port, item in config.inputs.items()
    }
    found: dict[str, Wire] = {}
    for name, link in params.inputs.items():
        keys = ("inputs", name)
        found |= problems.attempt(keys, partial(_linked, model, ports, name, link)) or {}
    inputs = [name for name, item in model.places.items() if item.causality == "input"]
    for name in [name for name in inputs if name not in found] if params.by_name else ():
        found |= problems.attempt(("inputs",), partial(_automatic, model, ports, name)) or {}
    left = [name for name in inputs if name not in found]
    made = {port: [wire for wire in found.values() if wire.port == port] for port in ports}
    for port in [port for port in ports if not made[port] and not len(problems)]:
        problems.add(
            ("inputs",),
            f"nothing of the input port {port!r} has the name of an input variable; say what "
            f"goes where: `params: {{inputs: {{{(left or ['u'])[0]}: {port}.NAME}}}}` (of the "
            f"port: {', '.join(ports[port].offers[:8])}; open variables: "
            f"{', '.join(left[:8]) or 'none'})",
        )
    return made


def _automatic(model: Model, ports: Mapping[str, _Port], name: str) -> dict[str, Wire]:
    """Return the wire of an input that no link names: of the one port that has its name."""
    having = [port for port, item in ports.items() if name in item.names]
    if len(having) > 1:
        text = f"{name} is in several ports, {', '.join(having)}; say in `inputs` which"
        raise WiringError(text)
    if having:
        return _linked(model, ports, name, Link(from_=f"{having[0]}.{name}"))
    port, _, what = name.partition(".")
    match = _ELEMENT.fullmatch(what)
    if port not in ports or (match[1] if match else what) not in ports[port].fields:
        return {}
    if match and match[2].isdigit():
        what = f"{match[1]}[{int(match[2]) - 1}]"  # FMI counts from 1
    return _linked(model, ports, name, Link(from_=f"{port}.{what}"))


def _linked(model: Model, ports: Mapping[str, _Port], name: str, link: Link) -> dict[str, Wire]:
    """Return the wires of a link by their targets: one, or one for each element of an array."""
    item, port, what = ends_of(model, ports, name, link)
    source, found = ports[port], {}
    for index, target in enumerate([name] if name in model.places else names_of(item)):
        part = what
        if target != name:
            # Of an array: the element of the same name, or in the same place.
            part = target.replace(name, what, 1)
            part = part if part in source.names else f"{what}[{index}]"
        field, places, unit = source.find(part)
        factor, offset = model.units.conversion(unit, item.unit) if link.convert else (1.0, 0.0)
        scale = factor * link.factor, factor * link.offset + offset
        found[target] = Wire(port, field, places, item, target, scale)
    return found
