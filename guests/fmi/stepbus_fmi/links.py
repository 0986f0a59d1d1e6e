"""Which value of which message an input variable gets."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from stepbus_participant import Config, Problems
from stepbus_schemas import Description, Message, Row, WiringError, fields_of, suggest
from stepbus_schemas.declaration import class_declaration

from .model import Model, Variable
from .params import Link
from .units import Units

_ELEMENT = re.compile(r"(.+)\[([^\[\]]+)\]")
Place = tuple[str, tuple[int, ...]]
"""Field of a message, and the places in it."""


@dataclass(frozen=True)
class Wire:
    """One value on its way: port and place in its message → name of an input.

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
        if isinstance(value, bool) and self.variable.kind in (int, float):
            value = self.variable.kind(value)  # 0 or 1, as other tools do
        # Not 1 · value + 0, which turns −0 into 0.
        return value if self.scale == (1.0, 0.0) else value * self.scale[0] + self.scale[1]


def _rows(cls: type[Message]) -> dict[str, Row]:
    """Return the fields of a message type; none of one with parts that no declaration can say."""
    try:
        return fields_of(class_declaration(cls))
    except WiringError:
        return {}


class Wiring:
    """Finds the wires of an FMU's inputs, from the descriptions of their sources."""

    def __init__(
        self, model: Model, units: Units, config: Config, descriptions: Mapping[str, Description]
    ) -> None:
        self._model = model
        self._units = units
        self._rows = {port: _rows(config.types[item.type]) for port, item in config.inputs.items()}
        self._described = {port: descriptions.get(port, Description()) for port in config.inputs}

    def wires(
        self, links: Mapping[str, Link], problems: Problems, *, by_name: bool = True
    ) -> list[Wire]:
        """Return the wires; adds what is wrong, such as a port without a variable.

        by_name: whether inputs that no link names are connected by their names.
        """
        found: dict[str, Wire] = {}
        for name, link in links.items():
            keys = ("inputs", name)
            found |= problems.attempt(keys, partial(self._linked, name, link)) or {}
        places = self._model.places.items()
        left = [n for n, (item, _) in places if item.causality == "input" and n not in found]
        for name in left if by_name else ():
            found |= problems.attempt(("inputs",), partial(self._automatic, name)) or {}
        used = {wire.port for wire in found.values()}
        left = [name for name in left if name not in found]
        for port in [port for port in self._rows if port not in used and not len(problems)]:
            problems.add(
                ("inputs",),
                f"nothing of the input port {port!r} has the name of an input variable; say what "
                f"goes where: `params: {{inputs: {{{(left or ['u'])[0]}: {port}.NAME}}}}` (of the "
                f"port: {', '.join(self._offers(port)[:8])}; open variables: "
                f"{', '.join(left[:8]) or 'none'})",
            )
        return list(found.values())

    def _offers(self, port: str) -> list[str]:
        names = self._described[port].names
        return names if self._vector(port) and names else list(self._rows[port])

    def _vector(self, port: str) -> str:
        """Return the only field of a port that has a value for each name of it, or nothing."""
        fields = [
            name for name, row in self._rows[port].items() if str(row["type"]).endswith("[n]")
        ]
        return fields[0] if len(fields) == len(self._rows[port]) == 1 else ""

    def _automatic(self, name: str) -> dict[str, Wire]:
        """Return the wire of an input that no link names: of the one port that has its name."""
        ports = [p for p in self._rows if self._vector(p) and name in self._described[p].names]
        if len(ports) > 1:
            text = f"{name} is in several ports, {', '.join(ports)}; say in `inputs` which"
            raise WiringError(text)
        if ports:
            return self._linked(name, Link(from_=f"{ports[0]}.{name}"))
        port, _, rest = name.partition(".")
        match = _ELEMENT.fullmatch(rest)
        field = match[1] if match else rest
        if field not in self._rows.get(port, ()):
            return {}
        # FMI counts from 1.
        place = f"[{int(match[2]) - 1}]" if match and match[2].isdigit() else ""
        return self._linked(name, Link(from_=f"{port}.{field}{place}"))

    def _linked(self, name: str, link: Link) -> dict[str, Wire]:
        """Return the wires of a link by their targets: one, or one for each element of an array."""
        item, first = self._model.places.get(name) or (self._model.find(name), None)
        if item.causality != "input":
            raise WiringError(f"{name} is no input of the FMU: its causality is {item.causality}")
        port, _, what = link.from_.partition(".")
        if port not in self._rows or not what:
            text = f"{link.from_!r} names no input port; write PORT.NAME"
            raise WiringError(text + suggest(port, self._rows))
        found = {}
        for index in range(item.size) if first is None else [first]:
            source = what if first is not None else self._element(port, what, item, index)
            field, places, unit = self._find(port, source)
            convert = self._units.conversion(unit, item.unit) if link.convert else (1.0, 0.0)
            scale = convert[0] * link.factor, convert[0] * link.offset + convert[1]
            found[item.names[index]] = Wire(port, field, places, item, item.names[index], scale)
        return found

    def _element(self, port: str, what: str, item: Variable, index: int) -> str:
        """Return the source of one element of an array: of the same name, or in the same place."""
        named = item.names[index].replace(item.name, what, 1)
        return named if named in self._described[port].names else f"{what}[{index}]"

    def _find(self, port: str, what: str) -> tuple[str, tuple[int, ...], str]:
        """Return field, places and unit of a value of a port."""
        described, rows, vector = self._described[port], self._rows[port], self._vector(port)
        if vector and what in described.names:
            index = described.names.index(what)
            units = described.details.get("unit", [])
            return vector, (index,), units[index] if units else rows[vector].get("unit", "")
        match = _ELEMENT.fullmatch(what)
        field, inner = (match[1], match[2].split(",")) if match else (what, [])
        if field not in rows:
            offers = self._offers(port)
            raise WiringError(f"port {port!r} has no {what!r}{suggest(what, offers)}")
        places = tuple(self._place(described, text.strip()) for text in inner)
        return field, places, described.units.get(field) or rows[field].get("unit", "")

    @staticmethod
    def _place(described: Description, text: str) -> int:
        if text in described.names:
            return described.names.index(text)
        if text.isdigit():
            return int(text)
        raise WiringError(f"{text!r} is no place of a vector{suggest(text, described.names)}")
