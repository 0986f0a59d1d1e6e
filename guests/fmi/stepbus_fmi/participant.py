"""An FMU as a participant: its inputs and outputs are ports, its steps those of the run."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import groupby
from typing import Any

import msgspec

from stepbus_participant import (
    CallError,
    Config,
    InvalidInput,
    Method,
    Participant,
    Problems,
    Step,
    installed_version,
    warn,
)
from stepbus_schemas import Description, Message, WiringError, suggest

from .instance import Instance, Values, started
from .links import Wire, Wiring
from .model import Model, Variable, read_model
from .params import Params
from .proof import state_problem
from .start import read_value, start_values, texts
from .units import Units, registry

PORTS = {
    "Scalars/1": ("out", float),
    "Integers/1": ("out_integers", int),
    "Booleans/1": ("out_booleans", bool),
    "Texts/1": ("out_texts", str),
    "Binaries/1": ("out_binaries", bytes),
}
"""Type of a port with named values → name of the port that an FMU has of it, and what they are."""


class _State(msgspec.Struct):
    """What `save` returns. held: value of each discrete input, as last set, by name."""

    state: bytes
    held: dict[str, list[Any]]
    before: list[float]
    ended: bool


class Group:
    """Variables of one type, and the values that they get next."""

    def __init__(self, values: Values, variables: Sequence[Variable]) -> None:
        self.values = values
        starts = (0, *(sum(v.size for v in variables[: i + 1]) for i in range(len(variables))))
        self.first = dict(zip((v.name for v in variables), starts, strict=False))
        self.next: list[Any] = values.get()


def by_type(
    instance: Instance, variables: Sequence[Variable]
) -> Iterator[tuple[Values, list[Variable]]]:
    """Yield access to the variables of each type, and these."""
    ordered = sorted(variables, key=lambda item: item.type_name)
    for _, group in groupby(ordered, key=lambda item: item.type_name):
        items = list(group)
        yield instance.values(items), items


class Output:
    """An output port: from the values of variables to its message."""

    def __init__(self, instance: Instance, cls: type[Message], rows: Mapping[str, Any]) -> None:
        """Take field → list of (variable, index), one of them, or a constant."""
        self._cls = cls
        self._instance = instance
        wanted = [place for row in rows.values() for place in _places(row)]
        variables = list(dict.fromkeys(item for item, _ in wanted))
        self._groups = [(values, items) for values, items in by_type(instance, variables)]
        at: dict[tuple[str, int], tuple[int, int]] = {}
        for number, (_, items) in enumerate(self._groups):
            slots = [(item.name, index) for item in items for index in range(item.size)]
            at.update({slot: (number, place) for place, slot in enumerate(slots)})
        self._rows = {field: _located(row, at) for field, row in rows.items()}
        # Most ports: all values of one type, in their order.
        places = [place for _, place in at.values()]
        only = next(iter(self._rows), "")
        is_whole = len(self._groups) == 1 and list(self._rows.values()) == [
            [(0, place) for place in places]
        ]
        self._whole = only if is_whole else ""

    def message(self) -> Message:
        """Return the message of now."""
        got = [self._instance.get(values) for values, _ in self._groups]
        if self._whole:
            return self._cls(**{self._whole: got[0]})
        return self._cls(**{field: _taken(row, got) for field, row in self._rows.items()})


def _places(row: Any) -> list[tuple[Variable, int]]:
    return row if isinstance(row, list) else [row] if isinstance(row, tuple) else []


def _located(row: Any, at: Mapping[tuple[str, int], tuple[int, int]]) -> Any:
    if isinstance(row, list):
        return [at[item.name, index] for item, index in row]
    return at[row[0].name, row[1]] if isinstance(row, tuple) else row


def _taken(row: Any, got: Sequence[Sequence[Any]]) -> Any:
    if isinstance(row, list):
        return [got[group][place] for group, place in row]
    return got[row[0]][row[1]] if isinstance(row, tuple) else row


class Fmu(Participant):
    """An FMU for co-simulation."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        problems = config.problems()
        self._params = params = config.read(Params, problems)
        below = problems.below(("params",))
        model = problems.attempt(
            ("params", "fmu"), lambda: read_model(params.fmu, params.inside, params.start)
        )
        problems.refuse()
        assert model is not None  # noqa: S101  refused above
        self.model: Model = model
        self._units = Units(model.description)
        if config.inputs and any(item.unit for item in model.of("input")):
            registry()
        self._start = start_values(model, self._units, params.start, below)
        self._h = config.every * config.step_ns / 1e9
        self._done = 0
        self._proved: bool | None = None
        self._slopes = self._extrapolated(below)
        for text in self._step_problems():
            problems.add((), text)
        rows = {port: self._output_rows(port, problems) for port in config.outputs}
        problems.refuse()
        self._instance = started(model, params, self._start)
        self._outputs = {
            port: Output(self._instance, config.types[config.outputs[port].type], row)
            for port, row in rows.items()
        }
        self._tunable = {
            item.name: item
            for item in model.variables.values()
            if item.variability == "tunable" and item.causality == "parameter"
        }
        self._rows = rows
        self._continuous: list[Group] = []
        self._discrete: list[Group] = []
        self._wires: dict[str, list[tuple[Wire, Group, int]]] = {}
        self._before: list[float] = []
        self._is_changed = False

    # --- what the scenario asks for -------------------------------------------------------

    def _extrapolated(self, problems: Problems) -> list[Variable]:
        found = []
        for name in self._params.extrapolate:
            item = problems.attempt(("extrapolate",), partial(self.model.find, name))
            if item is None:
                continue
            if item.causality != "input" or item.kind is not float or item.shape:
                problems.add(("extrapolate",), f"{name} is no input that is one real number")
            found.append(item)
        if found and not (self.model.major == 2 and self.model.can.canInterpolateInputs):
            problems.add(("extrapolate",), f"{self.model.file} cannot interpolate its inputs")
        return found

    def _step_problems(self) -> Iterator[str]:
        """Yield why the FMU cannot take steps of this length."""
        can = self.model.can
        fixed = float(can.fixedInternalStepSize or 0)
        if can.canHandleVariableCommunicationStepSize or not fixed:
            return
        count = self._h / fixed
        if count < 0.5 or abs(count - round(count)) > 1e-9 * count:
            yield (
                f"{self.model.file} takes steps that are whole multiples of {fixed:g} s only, and "
                f"its step is {self._h:g} s; change `step` of the scenario, or its `every`"
            )

    def _output_rows(self, port: str, problems: Problems) -> Mapping[str, Any]:
        """Return field → variables or constant of an output port."""
        name = self.config.outputs[port].type
        mapped = self._params.outputs.get(port)
        keys = ("params", "outputs", port)
        if mapped is None and name in PORTS:
            kind = PORTS[name][1]
            items = self.published(kind, problems)
            if not items:
                text = f"{self.model.file} has no such output variables; leave the port out"
                problems.add(("outputs", port), text)
            return {"values": [(item, index) for item in items for index in range(item.size)]}
        if mapped is None:
            text = f"say which variables {name} has: `params: {{outputs: {{{port}: …}}}}`"
            problems.add(("outputs", port), text)
            return {}
        cls = self.config.types[name]
        rows = {}
        for field, value in mapped.items():
            if field == "names":
                continue
            if field not in cls.__struct_fields__:
                text = f"{name} has no field {field!r}{suggest(field, cls.__struct_fields__)}"
                problems.add((*keys, field), text)
            rows[field] = self._row(value)
        return rows

    def _row(self, value: Any) -> Any:
        """Return a list of places for variables, one for a variable, anything else as it is."""
        places = self.model.places
        if (
            isinstance(value, list)
            and value
            and all(v in places for v in value if isinstance(v, str))
        ):
            return [places[v] if isinstance(v, str) else v for v in value]
        if isinstance(value, str) and value in self.model.variables:
            item = self.model.variables[value]
            return [(item, i) for i in range(item.size)] if item.shape else (item, 0)
        return places[value] if isinstance(value, str) and value in places else value

    def published(self, kind: type, problems: Problems) -> list[Variable]:
        """Return the variables of a kind that are published without being asked for one by one."""
        found = self.model.of("output", kind)
        for name in self._params.publish:
            item = problems.attempt(("params", "publish"), partial(self.model.find, name))
            if item is not None and item.kind is kind and item not in found:
                found.append(item)
        return found

    # --- the run --------------------------------------------------------------------------

    def describe(self) -> dict[str, Description]:
        """Return the names of all values, and their units."""
        return {port: self._description(port, rows) for port, rows in self._rows.items()}

    def _description(self, port: str, rows: Mapping[str, Any]) -> Description:
        names = self._params.outputs.get(port, {}).get("names")
        if isinstance(names, str):
            return Description(like=names)
        if names is not None:
            return Description(names=list(names))
        if self.config.outputs[port].type not in PORTS:
            return Description()
        places = rows.get("values", [])
        units = [item.unit for item, _ in places]
        details = {"unit": units} if any(units) else {}
        media = [item.media for item, _ in places]
        details |= {"media": media} if any(media) else {}
        return Description(names=[item.names[i] for item, i in places], details=details)

    def versions(self) -> dict[str, str]:
        """Return the version of FMPy, and what the FMU says of itself."""
        said = self.model.description
        by = {"FMU": f"{said.modelName} {said.version or ''}".strip()}
        return {
            "FMPy": installed_version("fmpy"),
            **by,
            "made by": said.generationTool or "unknown",
        }

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Connect the input variables; raises SettingsError that lists what is wrong."""
        problems = self.config.problems()
        wiring = Wiring(self.model, self._units, self.config, inputs)
        links, by_name = self._params.inputs, self._params.by_name
        wires = wiring.wires(links, problems.below(("params",)), by_name=by_name)
        problems.refuse()
        used = list(dict.fromkeys(wire.variable for wire in wires))
        is_event = {v.name: v.variability != "continuous" for v in used}
        groups: dict[str, Group] = {}
        for wanted, kept in ((False, self._continuous), (True, self._discrete)):
            chosen = [item for item in used if is_event[item.name] is wanted]
            for values, items in by_type(self._instance, chosen):
                kept.append(Group(values, items))
                groups |= {item.name: kept[-1] for item in items}
        for wire in wires:
            group = groups[wire.variable.name]
            slot = group.first[wire.variable.name] + wire.index
            self._wires.setdefault(wire.port, []).append((wire, group, slot))

    def output(self, step: Step) -> dict[str, Message]:
        """Return the values at the time of the step."""
        return {port: output.message() for port, output in self._outputs.items()}

    def update(self, step: Step) -> dict[str, Message] | None:
        """Set the inputs, and do the step from this time to the next."""
        self._take_inputs(step)
        now = self._params.start_time + self._done * self._h
        self._done += 1
        instance = self._instance
        continuous = {group.values: group.next for group in self._continuous}
        events = {group.values: group.next for group in self._discrete} if self._is_changed else {}
        self._is_changed = False
        if not instance.ended:
            instance.apply(continuous, events)
            if self._slopes:
                self._set_slopes()
            instance.step(now, self._h)
        if instance.ended:
            step.end(f"the FMU {self.model.description.modelName} ends the simulation")
        return None if self.config.publishes == "first" else self.output(step)

    def _take_inputs(self, step: Step) -> None:
        for port, wires in self._wires.items():
            if not step.is_new(port) or (message := step.get(port)) is None:
                continue
            for wire, group, slot in wires:
                try:
                    value = wire.value(message)
                    if type(value) is not wire.variable.kind:
                        value = read_value(wire.variable, value, self._units)
                except (IndexError, TypeError, WiringError) as exc:
                    what = f"{wire.field}{list(wire.places) or ''} of the message: {exc}"
                    raise InvalidInput(port, f"for {wire.variable.name}: {what}") from exc
                if group.next[slot] != value and group in self._discrete:
                    self._is_changed = True
                group.next[slot] = value

    def _set_slopes(self) -> None:
        """Tell the FMU how its inputs go on, as far as their last two values tell."""
        now = [
            group.next[group.first[item.name]]
            for item in self._slopes
            for group in self._continuous
            if item.name in group.first
        ]
        if len(now) == len(self._before) == len(self._slopes):
            slopes = [(a - b) / self._h for a, b in zip(now, self._before, strict=True)]
            self._instance.set_slopes([item.reference for item in self._slopes], slopes)
        self._before = now

    def calls(self) -> dict[str, Method]:
        """Return what users can call between two steps."""
        help_set = (
            f"sets a tunable parameter: {texts(list(self._tunable.values())) or 'there is none'}"
        )
        return {
            "get": Method(self.get_value, "returns the value of a variable"),
            "set": Method(self.set_value, help_set, changes=True),
        }

    def get_value(self, name: str) -> Any:
        """Return the value of a variable."""
        item = self._known(name)
        values = self._instance.get(self._instance.values([item]))
        return values if item.shape else values[0]

    def set_value(self, name: str, value: Any) -> None:
        """Set a tunable parameter."""
        item = self._known(name)
        if name not in self._tunable or item.shape:
            raise CallError(f"{name} is not tunable{suggest(name, self._tunable)}")
        try:
            read = read_value(item, value, self._units)
        except WiringError as exc:
            raise CallError(str(exc)) from exc
        self._instance.apply({}, {self._instance.values([item]): [read]})

    def _known(self, name: str) -> Variable:
        try:
            return self.model.find(name)
        except WiringError as exc:
            raise CallError(str(exc)) from exc

    # --- state ----------------------------------------------------------------------------

    def prepare_saves(self) -> None:
        """Find out whether a state of this FMU can be restored in another process."""
        if self.model.saves:
            why = state_problem(self._params, dict(self._params.start), self._h)
        else:
            why = "it cannot save its state (canSerializeFMUState)"
        if why:
            warn(f"no checkpoints of {self.model.file}: {why}; a branch repeats it from step 0")
        self._proved = not why

    def save(self) -> bytes | None:
        """Return the state of the FMU, where that can be restored in another process."""
        if not self._proved:
            return None
        state = _State(
            state=self._instance.save(),
            held={str(n): g.next for n, g in enumerate((*self._continuous, *self._discrete))},
            before=self._before,
            ended=self._instance.ended,
        )
        return msgspec.msgpack.encode((self._done, state))

    def restore(self, state: bytes) -> None:
        """Take a state of another process."""
        self._done, saved = msgspec.msgpack.decode(state, type=tuple[int, _State])
        self._instance.restore(saved.state)
        for number, group in enumerate((*self._continuous, *self._discrete)):
            group.next = saved.held[str(number)]
        self._before, self._instance.ended = saved.before, saved.ended

    def close(self) -> None:
        """End the FMU."""
        self._instance.close()
