"""Between a policy and its ports: messages to an observation, an action to messages."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from stepbus_participant import Settings, suggest
from stepbus_schemas import Description, Message, RunError, Types, WiringError

from .fields import Field, Form, entries, forms

Vector = NDArray[np.float64]
_JOINT_STATE = "JointState/1"
_JOINT_COMMAND = "JointCommand/1"
_OF_MODE = {
    "torque": ("effort", "N·m"),
    "velocity": ("velocity", "rad/s"),
    "position": ("position", "rad"),
}
"""Mode of a joint command → the quantity that limits its values, and its unit."""
_UNLIMITED = (-math.inf, math.inf)


class Params(Settings):
    """Parameters of a policy; `StepbusEnv` writes them."""

    policy: str = ""
    """The function of an observation that returns an action, `module:function`; a class is made
    once. Empty: the command line names it."""
    observe: tuple[str, ...] = ()
    """What it sees, `port` or `port.field`, in this order. Empty: all numbers of all inputs."""
    act: tuple[str, ...] = ()
    """What it does, `port` or `port.field`."""
    joints: tuple[str, ...] = ()
    """Which joints it commands. Empty: those of its first input of joint states."""
    mode: Literal["torque", "velocity", "position"] = "torque"
    """How it commands joints."""
    limits: dict[str, tuple[float, float]] = msgspec.field(default_factory=dict)
    """`port.field` → lowest and highest value, where nothing describes them."""


@dataclass(frozen=True, kw_only=True)
class PolicyPorts:
    """The ports of a policy, by message type. types: those of the scenario."""

    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    types: Types

    def forms(self, side: str, port: str) -> dict[str, Form]:
        """Return what the fields of a port may hold; side: `inputs` or `outputs`."""
        return forms(self.types[getattr(self, side)[port]])

    def selected(self, side: str, wanted: Sequence[str]) -> dict[str, list[str]]:
        """Return port → fields of what is wanted of a side, `port` or `port.field`.

        Raises WiringError for what does not exist or is no vector of numbers.
        """
        known: Mapping[str, str] = getattr(self, side)
        by_port: dict[str, list[str]] = {}
        for text in wanted:
            port, _, field = text.partition(".")
            if port not in known:
                raise WiringError(
                    f"{text}: no port {port!r} among its {side}{suggest(port, known)}; "
                    f"it has {', '.join(known) or 'none'}"
                )
            fits = [name for name, form in self.forms(side, port).items() if form.fits]
            if field and field not in fits:
                raise WiringError(
                    f"{text}: {known[port]} has no numeric field {field!r}{suggest(field, fits)}; "
                    f"it has {', '.join(fits) or 'none of a fixed number'}"
                )
            by_port.setdefault(port, []).extend([field] if field else fits)
        return by_port

    def observed(self, params: Params) -> dict[str, list[str]]:
        """Return port → fields of an observation."""
        return self.selected("inputs", params.observe or tuple(self.inputs))

    def done(self, params: Params) -> dict[str, list[str]]:
        """Return port → fields of an action."""
        return self.selected("outputs", params.act)

    def check(self, params: Params) -> None:
        """Raise WiringError for what a policy cannot see or do, or limits that are none."""
        chosen = [*self.observed(params).items(), *self.done(params).items()]
        known = [f"{port}.{field}" for port, fields in chosen for field in fields]
        for name, (low, high) in params.limits.items():
            if name not in known:
                raise WiringError(
                    f"limits: {name!r} is neither observed nor an action{suggest(name, known)}"
                )
            if not low <= high:
                raise WiringError(f"limits: {name!r} must be (lowest, highest), not {(low, high)}")

    def default_action(self, read: Sequence[str]) -> list[str]:
        """Return what an action holds by default: what the outputs need that others read.

        read: these outputs.
        """
        return [
            f"{port}.{name}"
            for port in read
            for name, form in self.forms("outputs", port).items()
            if form.fits
            and form.is_required
            and (self.outputs[port] != _JOINT_COMMAND or name == "values")
        ]

    def described(self, params: Params) -> dict[str, Description]:
        """Return how a policy describes its outputs: the joints that it commands."""
        state = next((port for port, of in self.inputs.items() if of == _JOINT_STATE), None)
        outputs = {}
        for port in self.done(params):
            if not any("n" in form.sizes for form in self.forms("outputs", port).values()):
                continue
            if not params.joints and state is None:
                raise WiringError(f"{port}: its joints have no known names; give `joints`")
            outputs[port] = Description(
                names=list(params.joints), like=None if params.joints else state
            )
        return outputs


@dataclass(frozen=True)
class _Array:
    """Where some numbers of an observation or an action stand."""

    port: str
    field: str
    shape: tuple[int, ...]
    count: int


_Part = tuple[str, slice, tuple[int, ...] | None]
"""A field of a message, which numbers of an action it takes, and in which shape; None: a list."""


class Interface:
    """The observation and the action of one policy.

    inputs: how they are described. Raises WiringError for what does not fit.

    action: one field for each number of an action. observation: of an observation; none before
    the first. needed: inputs without which there is no observation.
    """

    def __init__(
        self, ports: PolicyPorts, params: Params, inputs: Mapping[str, Description]
    ) -> None:
        ports.check(params)
        self._ports, self._params, self._inputs = ports, params, inputs
        self._wanted = ports.observed(params)
        self.needed = [port for port, fields in self._wanted.items() if fields]
        self._observed: list[tuple[str, str, int, _Array]] = []
        self.observation: list[Field] = []
        described = ports.described(params)
        self._joints = {
            port: description.names or list(inputs[str(description.like)].names)
            for port, description in described.items()
        }
        self._commanded: list[tuple[_Array, slice]] = []
        self.action: list[Field] = []
        for port, names in ports.done(params).items():
            for name in names:
                self._plan(port, ports.forms("outputs", port)[name])
        self._lows = [field.low for field in self.action]
        self._highs = [field.high for field in self.action]
        self._plans = [(port, *self._plan_of(port)) for port in ports.done(params)]

    # --- observations ---------------------------------------------------------------------

    def observe(self, inputs: Mapping[str, Message | None], step: int) -> Vector:
        """Return the observation of a step; raises RunError where its form has changed."""
        if not self._observed:
            self._learn(inputs)
        values: list[float] = []
        for port, field, length, array in self._observed:
            value = getattr(inputs[port], field)
            if length and value is not None and len(value) == length:
                values += value
            else:
                values += _flat(value, array, step)
        return np.array(values, np.float64)

    def _learn(self, inputs: Mapping[str, Message | None]) -> None:
        """Take what the first messages have as what all have."""
        for port, fields in self._wanted.items():
            for name in fields:
                value = getattr(inputs[port], name)
                if value is not None:
                    self._add(port, self._ports.forms("inputs", port)[name], np.shape(value))
        if not self._observed:
            raise WiringError(
                "nothing to observe: no input is numeric; it has "
                f"{', '.join(self._ports.inputs) or 'none'}"
            )

    def _add(self, port: str, form: Form, shape: tuple[int, ...]) -> None:
        described = self._inputs.get(port, Description())
        names = described.names if form.sizes[:1] == ("n",) else []
        array = _Array(port, form.name, shape, math.prod(shape))
        unit = described.units.get(form.name, form.unit)
        # Without a length: it is no list of numbers.
        length = array.count if len(shape) == 1 else 0
        self._observed.append((port, form.name, length, array))
        self.observation += self._fields(array, names, [described], form.name, unit)

    def _fields(
        self,
        array: _Array,
        names: list[str],
        states: Sequence[Description],
        quantity: str,
        unit: str,
    ) -> Iterator[Field]:
        """Yield the field of each number of an array.

        names: along its first axis. states: which may describe these joints. quantity: what limits
        it. Raises WiringError for a joint that the states lack.
        """
        name = f"{array.port}.{array.field}"
        given = self._params.limits.get(name)
        is_of_joints = bool(names) and array.shape == (len(names),)
        for entry in entries(array.shape, names):
            described, joint = _joint(entry, states) if is_of_joints else (Description(), -1)
            low, high = given or _limits(described, quantity, joint)
            yield Field(
                name=f"{name}[{entry}]" if entry else name,
                port=array.port,
                field=array.field,
                entry=entry,
                unit=described.unit(unit, joint),
                low=low,
                high=high,
            )

    # --- actions --------------------------------------------------------------------------

    def messages(self, action: Vector) -> dict[str, Message]:
        """Return the messages of an action, which is clipped at its limits."""
        # Of a few numbers, this takes a tenth of what NumPy takes.
        values: list[Any] = [
            low if value < low else high if value > high else value  # noqa: FURB136  (quicker)
            for value, low, high in zip(action.tolist(), self._lows, self._highs, strict=True)
        ]
        messages: dict[str, Message] = {}
        for port, make, rows in self._plans:
            fields = {}
            for field, part, shape in rows:
                numbers = values[part]
                fields[field] = numbers if shape is None else np.reshape(numbers, shape).tolist()
            messages[port] = make(**fields)
        return messages

    def _plan(self, port: str, form: Form) -> None:
        """Add a field of an output to the action."""
        joints = self._joints[port] if "n" in form.sizes else []
        shape = form.shape(len(joints))
        array = _Array(port, form.name, shape, math.prod(shape))
        quantity, unit = form.name, form.unit
        if self._ports.outputs[port] == _JOINT_COMMAND and form.name == "values":
            quantity, unit = _OF_MODE[self._params.mode]
        states = [self._inputs[p] for p, of in self._ports.inputs.items() if of == _JOINT_STATE]
        fields = list(self._fields(array, joints, states, quantity, unit))
        for field in fields:
            if not (math.isfinite(field.low) and math.isfinite(field.high)):
                name = f"{port}.{form.name}"
                raise WiringError(
                    f"{name}: the limits of {field.entry or 'it'} are unknown; give "
                    f"limits={{'{name}': (lowest, highest)}}"
                )
        self._commanded.append((array, slice(len(self.action), len(self.action) + array.count)))
        self.action += fields

    def _plan_of(self, port: str) -> tuple[Callable[..., Message], list[_Part]]:
        """Return what makes a message, from the parts of the action that are returned as well."""
        rows = [(array, part) for array, part in self._commanded if array.port == port]
        chosen = {array.field for array, _ in rows}
        constants = {
            name: form.neutral(len(self._joints.get(port, ())))
            for name, form in self._ports.forms("outputs", port).items()
            if form.is_required and name not in chosen
        }
        if self._ports.outputs[port] == _JOINT_COMMAND:
            constants["mode"] = self._params.mode
        parts = [(a.field, part, None if len(a.shape) == 1 else a.shape) for a, part in rows]
        return partial(self._ports.types[self._ports.outputs[port]], **constants), parts


def _joint(name: str, states: Sequence[Description]) -> tuple[Description, int]:
    """Return the description of a joint's state, and its index there; −1: there are no states."""
    for described in states:
        if name in described.names:
            return described, described.names.index(name)
    if states:
        known = [joint for described in states for joint in described.names]
        raise WiringError(f"joints: no joint {name!r}{suggest(name, known)}")
    return Description(), -1


def _limits(described: Description, quantity: str, joint: int) -> tuple[float, float]:
    """Return what a description says of one number."""
    limits = described.limits
    if joint < 0:
        return _UNLIMITED
    if quantity in {"position", "target"} and {"lower", "upper"} <= limits.keys():
        return limits["lower"][joint], limits["upper"][joint]
    if quantity in {"velocity", "effort"} and quantity in limits:
        return -limits[quantity][joint], limits[quantity][joint]
    return _UNLIMITED


def _flat(value: Any, array: _Array, step: int) -> list[float]:
    if value is None or np.shape(value) != array.shape:
        now = "is absent" if value is None else f"has shape {np.shape(value)}"
        raise RunError(
            f"step {step}: {array.port}.{array.field} {now}, in the first observation it had "
            f"{array.shape}; leave it out with `observe`"
        )
    numbers: list[float] = np.asarray(value, dtype=np.float64).ravel().tolist()
    return numbers


def bounds(fields: Sequence[Field]) -> Iterator[Vector]:
    """Yield the lowest and highest values that a measurement stays within.

    These are the efforts' limits, and the stops with some room: a joint leans on its stop, and
    passes its rated velocity.
    """
    for side, sign in (("low", -1), ("high", 1)):
        yield np.array(
            [
                getattr(field, side) + sign * 0.1 * (field.high - field.low)
                if field.field in {"position", "effort"} and math.isfinite(field.high - field.low)
                else sign * np.inf
                for field in fields
            ]
        )
