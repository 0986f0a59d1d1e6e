"""An FMU as a participant: its inputs and outputs are ports, its steps those of the run."""

from collections.abc import Callable, Mapping
from functools import partial
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

from .files import PORTS
from .instance import Instance
from .links import ends_of, wires
from .model import kind_of, names_of, read_model, read_value, start_values
from .params import Params
from .proof import state_problem
from .units import registry

_KINDS = {type_: kind for _, kind, type_ in PORTS}


_State = tuple[bytes, int, dict[str, Any], dict[str, float], bool]
"""What `save` returns: of the FMU; steps done; inputs as last set, and before; whether it ended."""


class Fmu(Participant):
    """An FMU for co-simulation."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        problems = config.problems()
        self._params = params = config.read(Params, problems)
        below = problems.below(("params",))
        self._h = config.every * config.step_ns / 1e9
        self._done = 0
        self._is_proved = self._is_changed = False
        self._before: dict[str, float] = {}
        try:
            self.model = read_model(params.fmu, params.inside, params.start)
        except WiringError as exc:
            problems.add_error(("params", "fmu"), exc)
            raise problems.error() from exc
        if config.inputs and any(item.unit for item in self.model.of("input")):
            registry()
        start = start_values(self.model, params.start, below)
        for name, link in params.inputs.items():
            ends = partial(ends_of, self.model, config.inputs, name, link)
            below.attempt(("inputs", name), ends)
        self._check(problems)
        self._rows = {port: self._row(port, problems) for port in config.outputs}
        problems.refuse()
        self._instance = Instance(self.model, params, start)
        self._makers = {port: self._maker(port) for port in config.outputs}
        self._tunable = {
            item.name: item
            for item in self.model.of("parameter")
            if item.variability == "tunable" and not item.shape
        }

    # --- what the scenario asks for -------------------------------------------------------

    def _check(self, problems: Problems) -> None:
        """Add why the FMU cannot extrapolate inputs, or take steps of this length."""
        model, names, keys = self.model, self._params.extrapolate, ("params", "extrapolate")
        if names and (model.is_3 or not model.can.canInterpolateInputs):
            problems.add(keys, f"{model.file} cannot interpolate its inputs")
        for name in names:
            item = problems.attempt(keys, partial(model.find, name))
            if item is not None and (item.causality != "input" or kind_of(item) is not float):
                problems.add(keys, f"{name} is no input that is a real number")
        fixed = model.internal_step
        if fixed and not model.can.canHandleVariableCommunicationStepSize:
            count = self._h / fixed
            if count < 0.5 or abs(count - round(count)) > 1e-9 * count:
                problems.add(
                    (),
                    f"{model.file} takes steps that are whole multiples of {fixed:g} s only, and "
                    f"its step is {self._h:g} s; change `step` of the scenario, or its `every`",
                )

    def _row(self, port: str, problems: Problems) -> dict[str, Any]:
        """Return field → name of a value, list of these, or a constant, of an output port."""
        type_name, model = self.config.outputs[port].type, self.model
        fields = self.config.types[type_name].__struct_fields__
        row = dict(self._params.outputs.get(port, {}))
        if not row and type_name in _KINDS:
            kind = _KINDS[type_name]
            more = (
                problems.attempt(("params", "publish"), partial(model.find, name))
                for name in self._params.publish
            )
            more = (item for item in more if item is not None and kind_of(item) is kind)
            found = dict.fromkeys((*model.of("output", kind), *more))
            if not found:
                text = f"{model.file} has no such output variables; leave the port out"
                problems.add(("outputs", port), text)
            return {"values": [name for item in found for name in names_of(item)]}
        if not row:
            text = f"say which variables {type_name} has: `params: {{outputs: {{{port}: …}}}}`"
            problems.add(("outputs", port), text)
        row.pop("names", None)
        for field, value in row.items():
            if field not in fields:
                text = f"{type_name} has no field {field!r}{suggest(field, fields)}"
                problems.add(("params", "outputs", port, field), text)
            if isinstance(value, str) and value in model.variables:
                # An array stands for its values.
                item = model.variables[value]
                row[field] = names_of(item) if item.shape else value
        return row

    def _maker(self, port: str) -> Callable[[], Message]:
        """Return what makes the message of an output port."""
        cls, row = self.config.types[self.config.outputs[port].type], self._rows[port]
        places = self.model.places
        texts = [one for v in row.values() for one in (v if isinstance(v, list) else [v])]
        used = [places[text] for text in texts if isinstance(text, str) and text in places]
        groups = self._instance.values(dict.fromkeys(used))
        if row.keys() == {"values"} and [group.names for group in groups] == [row["values"]]:
            # Most ports: all values of one type, in their order.
            get = groups[0].get
            return lambda: cls(values=self._instance.do(get))

        def make() -> Message:
            now = self._instance.get(groups)
            return cls(**{field: _filled(value, now) for field, value in row.items()})

        return make

    # --- the run --------------------------------------------------------------------------

    def describe(self) -> dict[str, Description]:
        """Return the names of all values, and their units."""
        found, places = {}, self.model.places
        for port, row in self._rows.items():
            names = self._params.outputs.get(port, {}).get("names")
            found[port] = Description(names=list(names or ()))
            if isinstance(names, str):
                found[port] = Description(like=names)
            elif names is None and self.config.outputs[port].type in _KINDS:
                names = row.get("values", [])
                units = [places[name].unit for name in names if name in places]
                details = {"unit": units} if any(units) else {}
                found[port] = Description(names=names, details=details)
        return found

    def versions(self) -> dict[str, str]:
        """Return the version of FMPy, and what the FMU says of itself."""
        said = self.model.description
        name = f"{said.modelName} {said.version or ''}".strip()
        made_by = said.generationTool or "unknown"
        return {"FMPy": installed_version("fmpy"), "FMU": name, "made by": made_by}

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Connect the input variables; raises SettingsError that lists what is wrong."""
        problems = self.config.problems()
        below = problems.below(("params",))
        self._wires = wires(self.model, self.config, inputs, self._params, below)
        problems.refuse()
        used = dict.fromkeys(wire.variable for some in self._wires.values() for wire in some)
        values = self._instance.values
        self._continuous = values(v for v in used if v.variability == "continuous")
        self._discrete = values(v for v in used if v.variability != "continuous")
        self._next = self._instance.get([*self._continuous, *self._discrete])

    def output(self, step: Step) -> dict[str, Message]:
        """Return the values at the time of the step."""
        return {port: make() for port, make in self._makers.items()}

    def update(self, step: Step) -> dict[str, Message] | None:
        """Set the inputs, and do the step from this time to the next."""
        instance = self._instance
        for port in self._wires:
            if step.is_new(port) and (message := step.get(port)) is not None:
                self._take(port, message)
        now = self._params.start_time + self._done * self._h
        self._done += 1
        if not instance.ended:
            instance.set(self._continuous, self._next)
            if self._is_changed:
                instance.set_in_event(self._discrete, self._next)
                self._is_changed = False
            if self._params.extrapolate:
                self._extrapolate()
            instance.step(now, self._h)
        if instance.ended:
            step.end(f"the FMU {self.model.description.modelName} ends the simulation")
        return None if self.config.publishes == "first" else self.output(step)

    def _take(self, port: str, message: Message) -> None:
        for wire in self._wires[port]:
            item = wire.variable
            try:
                value = wire.value(message)
                if type(value) is not kind_of(item):
                    value = read_value(item, value, self.model.units)
            except (IndexError, TypeError, WiringError) as exc:
                what = f"{wire.field}{list(wire.places) or ''} of the message: {exc}"
                raise InvalidInput(port, f"for {item.name}: {what}") from exc
            if item.variability != "continuous" and self._next[wire.target] != value:
                self._is_changed = True
            self._next[wire.target] = value

    def _extrapolate(self) -> None:
        """Tell the FMU how its inputs go on, as far as their last two values tell."""
        now = {name: self._next[name] for name in self._params.extrapolate if name in self._next}
        if self._before:
            slopes = [(value - self._before[name]) / self._h for name, value in now.items()]
            self._instance.set_slopes([self.model.variables[n].valueReference for n in now], slopes)
        self._before = now

    def calls(self) -> dict[str, Method]:
        """Return what users can call between two steps."""
        names = ", ".join([*self._tunable][:5]) or "there is none"
        text = f"sets a tunable parameter: {names}"
        return {"set": Method(self.set_value, text, changes=True)}

    def set_value(self, name: str, value: Any) -> None:
        """Set a tunable parameter."""
        if name not in self._tunable:
            raise CallError(f"{name} is not tunable{suggest(name, self._tunable)}")
        item = self._tunable[name]
        try:
            read = read_value(item, value, self.model.units)
        except WiringError as exc:
            raise CallError(str(exc)) from exc
        self._instance.set_in_event(self._instance.values([item]), {name: read})

    # --- state ----------------------------------------------------------------------------

    def prepare_saves(self) -> None:
        """Find out whether a state of this FMU can be restored in another process."""
        why = "it cannot save its state (canSerializeFMUState)"
        if self.model.can.canSerializeFMUstate:
            why = state_problem(self.config.params, self._params, self._h)
        if why:
            warn(f"no checkpoints of {self.model.file}: {why}; a branch repeats it from step 0")
        self._is_proved = not why

    def save(self) -> bytes | None:
        """Return the state of the FMU, where that can be restored in another process."""
        if not self._is_proved:
            return None
        fmu, ended = self._instance.save(), self._instance.ended
        return msgspec.msgpack.encode((fmu, self._done, self._next, self._before, ended))

    def restore(self, state: bytes) -> None:
        """Take a state of another process."""
        fmu, *kept, ended = msgspec.msgpack.decode(state, type=_State)
        self._instance.restore(fmu)
        self._done, self._next, self._before = kept
        self._instance.ended = ended

    def close(self) -> None:
        """End the FMU."""
        self._instance.close()


def _filled(value: Any, now: Mapping[str, Any]) -> Any:
    """Return a value, or a list of them, in which names of variables are what these are now."""
    if isinstance(value, list):
        return [_filled(one, now) for one in value]
    return now.get(value, value) if isinstance(value, str) else value
