"""Between a policy and its ports: messages to an observation, an action to messages."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepbus_participant import suggest
from stepbus_schemas import Description, Message, RunError, Types, WiringError

from .fields import Field, Form, entries, forms, nested, sliding
from .policy.params import Params

Vector = NDArray[np.float64]
_JOINT_STATE = "JointState/1"
_JOINT_COMMAND = "JointCommand/1"
_OF_MODE = {"torque": "effort", "velocity": "velocity", "position": "position"}
_UNITS = {"torque": "N·m", "velocity": "rad/s", "position": "rad"}


@dataclass(frozen=True, kw_only=True)
class PortTypes:
    """The ports of a participant, by message type. types: those of the scenario."""

    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    types: Types

    def forms(self, side: str, port: str) -> dict[str, Form]:
        """Return what the fields of a port may hold."""
        return forms(self.types[(self.inputs if side == "inputs" else self.outputs)[port]])


def selected(ports: PortTypes, side: str, wanted: Sequence[str]) -> dict[str, list[str]]:
    """Return port → fields of what is wanted, `port` or `port.field`.

    Raises WiringError for what does not exist or is no vector of numbers.
    """
    known = ports.inputs if side == "inputs" else ports.outputs
    by_participant: dict[str, list[str]] = {}
    for text in wanted:
        port, _, field = text.partition(".")
        if port not in known:
            raise WiringError(
                f"{text}: no port {port!r} among its {side}{suggest(port, known)}; "
                f"it has {', '.join(known) or 'none'}"
            )
        fits = [name for name, form in ports.forms(side, port).items() if form.fits]
        if field and field not in fits:
            raise WiringError(
                f"{text}: {known[port]} has no numbers {field!r}{suggest(field, fits)}; "
                f"it has {', '.join(fits) or 'none of a fixed number'}"
            )
        by_participant.setdefault(port, []).extend([field] if field else fits)
    return by_participant


def check_limits(ports: PortTypes, params: Params) -> None:
    """Raise WiringError for limits of what is neither observed nor done, or that are none."""
    sides = {"inputs": params.observe or tuple(ports.inputs), "outputs": params.act}
    known = [
        f"{port}.{field}"
        for side, wanted in sides.items()
        for port, fields in selected(ports, side, wanted).items()
        for field in fields
    ]
    for name, (low, high) in params.limits.items():
        if name not in known:
            raise WiringError(
                f"limits: {name!r} is neither observed nor an action{suggest(name, known)}"
            )
        if not low <= high:
            raise WiringError(f"limits: {name!r} must be (lowest, highest), not {(low, high)}")


def default_action(ports: PortTypes, read: Sequence[str]) -> list[str]:
    """Return what an action holds where nobody says it: what the outputs need that are read.

    read: outputs that somebody reads.
    """
    fields = []
    for port in read:
        own = ports.forms("outputs", port)
        if ports.outputs[port] == _JOINT_COMMAND:
            fields.append(f"{port}.values")
        else:
            fields += [
                f"{port}.{name}" for name, form in own.items() if form.fits and form.is_required
            ]
    return fields


def described_outputs(ports: PortTypes, params: Params) -> dict[str, Description]:
    """Return how a policy describes its outputs: the joints that it commands."""
    state = next((port for port, of in ports.inputs.items() if of == _JOINT_STATE), None)
    outputs = {}
    for port in selected(ports, "outputs", params.act):
        if not any("n" in form.sizes for form in ports.forms("outputs", port).values()):
            continue
        if params.joints:
            outputs[port] = Description(names=list(params.joints))
        elif state is not None:
            outputs[port] = Description(like=state)
        else:
            raise WiringError(f"{port}: nothing names its joints; give `joints`")
    return outputs


@dataclass(frozen=True)
class _Source:
    """Where some numbers of an observation stand."""

    port: str
    field: str
    shape: tuple[int, ...]
    read: Any


class Interface:
    """The observation and the action of one policy.

    ports: of the participant. inputs: how they are described. Raises WiringError for what does
    not fit.

    action: one field for each number of an action. observation: of an observation; none before
    the first. needed: inputs without which there is no observation.
    """

    def __init__(self, ports: PortTypes, params: Params, inputs: Mapping[str, Description]) -> None:
        self._ports = ports
        self._params = params
        self._inputs = inputs
        check_limits(ports, params)
        wanted = params.observe or tuple(ports.inputs)
        self._wanted = selected(ports, "inputs", wanted)
        self.needed = [port for port, fields in self._wanted.items() if fields]
        self._sources: list[_Source] = []
        self.observation: list[Field] = []
        self._described = described_outputs(ports, params)
        self._outputs = list(self._planned())
        self.action = [field for *_, fields in self._outputs for field in fields]
        self._low = np.array([field.low for field in self.action])
        self._high = np.array([field.high for field in self.action])
        self._types = {port: ports.types[of] for port, of in ports.outputs.items()}
        self._fixed = {
            port: self._fixed_of(port) for port in selected(ports, "outputs", params.act)
        }

    # --- observations ---------------------------------------------------------------------

    def observe(self, inputs: Mapping[str, Message | None], step: int) -> Vector:
        """Return the observation of a step; raises RunError where its form has changed."""
        if not self._sources:
            self._learn(inputs)
        values: list[float] = []
        for source in self._sources:
            value = source.read(inputs[source.port])
            if len(source.shape) == 1 and value is not None and len(value) == source.shape[0]:
                values += value
            else:
                values += _flat(value, source, step)
        return np.array(values, dtype=np.float64)

    def _learn(self, inputs: Mapping[str, Message | None]) -> None:
        """Take what the first messages have as what all have."""
        for port, fields in self._wanted.items():
            for name in fields:
                value = getattr(inputs[port], name)
                if value is not None:
                    self._add(port, name, np.shape(value))
        if not self._sources:
            raise WiringError(
                "nothing to observe: no input has numbers; it has "
                f"{', '.join(self._ports.inputs) or 'none'}"
            )

    def _add(self, port: str, name: str, shape: tuple[int, ...]) -> None:
        described = self._inputs.get(port, Description())
        form = self._ports.forms("inputs", port)[name]
        self._sources.append(_Source(port, name, shape, attrgetter(name)))
        names = described.names if form.sizes[:1] == ("n",) else []
        unit = described.units.get(name, form.unit)
        for index, entry in enumerate(entries(shape, names)):
            joint = index if len(shape) == 1 and names else -1
            limits = self._params.limits.get(f"{port}.{name}", _limits(described, name, joint))
            unit_here = _unit(unit, described, joint)
            self.observation.append(_field(port, name, entry, unit=unit_here, limits=limits))

    # --- actions --------------------------------------------------------------------------

    def messages(self, action: Vector) -> dict[str, Message]:
        """Return the messages of an action, which is clipped at its limits."""
        values = np.minimum(np.maximum(action, self._low), self._high).tolist()
        given: dict[str, dict[str, Any]] = {port: {} for port in self._fixed}
        at = 0
        for port, name, shape, fields in self._outputs:
            given[port][name] = nested(values[at : at + len(fields)], shape)
            at += len(fields)
        return {port: self._types[port](**self._fixed[port], **own) for port, own in given.items()}

    def _planned(self) -> Iterator[tuple[str, str, tuple[int, ...], list[Field]]]:
        for port, names in selected(self._ports, "outputs", self._params.act).items():
            forms_of = self._ports.forms("outputs", port)
            for name in names:
                joints = self._joints(port) if "n" in forms_of[name].sizes else []
                shape = forms_of[name].shape(len(joints))
                yield port, name, shape, self._action_fields(port, forms_of[name], shape, joints)

    def _joints(self, port: str) -> list[str]:
        described = self._described[port]
        return described.names or list(self._inputs[str(described.like)].names)

    def _action_fields(
        self, port: str, form: Form, shape: tuple[int, ...], joints: list[str]
    ) -> list[Field]:
        is_command = self._ports.outputs[port] == _JOINT_COMMAND and form.name == "values"
        quantity = _OF_MODE[self._params.mode] if is_command else form.name
        unit = _UNITS[self._params.mode] if is_command else form.unit
        fields = []
        for index, entry in enumerate(entries(shape, joints)):
            described, joint = (
                self._joint(joints[index])
                if len(shape) == 1 and joints
                else (
                    Description(),
                    -1,
                )
            )
            name = f"{port}.{form.name}"
            low, high = self._params.limits.get(name, _limits(described, quantity, joint))
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise WiringError(
                    f"{name}: nothing describes the limits of {entry or 'it'}; give "
                    f"limits={{'{name}': (lowest, highest)}}"
                )
            unit_here = _unit(unit, described, joint)
            fields.append(_field(port, form.name, entry, unit=unit_here, limits=(low, high)))
        return fields

    def _joint(self, name: str) -> tuple[Description, int]:
        """Return the description of a joint's state, and where the joint stands in it."""
        states = [port for port, of in self._ports.inputs.items() if of == _JOINT_STATE]
        known = [joint for port in states for joint in self._inputs[port].names]
        if states and name not in known:
            raise WiringError(f"joints: no joint {name!r}{suggest(name, known)}")
        for port in states:
            if name in self._inputs[port].names:
                return self._inputs[port], self._inputs[port].names.index(name)
        return Description(), -1

    def _fixed_of(self, port: str) -> dict[str, Any]:
        """Return what a message needs beside the action."""
        chosen = {name for other, name, *_ in self._outputs if other == port}
        count = len(self._joints(port)) if port in self._described else 0
        constants = {
            name: form.neutral(count)
            for name, form in self._ports.forms("outputs", port).items()
            if form.is_required and name not in chosen
        }
        if self._ports.outputs[port] == _JOINT_COMMAND:
            constants["mode"] = self._params.mode
        return constants


def _field(port: str, name: str, entry: str, *, unit: str, limits: tuple[float, float]) -> Field:
    text = f"{port}.{name}[{entry}]" if entry else f"{port}.{name}"
    low, high = limits
    return Field(name=text, port=port, field=name, entry=entry, unit=unit, low=low, high=high)


def _unit(unit: str, described: Description, joint: int) -> str:
    types = described.details.get("type", [])
    return sliding(unit) if 0 <= joint < len(types) and types[joint] == "prismatic" else unit


def _limits(described: Description, quantity: str, index: int) -> tuple[float, float]:
    """Return what a description says of one number."""
    limits = described.limits
    if index < 0:
        return -math.inf, math.inf
    if quantity in {"position", "target"} and {"lower", "upper"} <= limits.keys():
        return limits["lower"][index], limits["upper"][index]
    if quantity in {"velocity", "effort"} and quantity in limits:
        return -limits[quantity][index], limits[quantity][index]
    return -math.inf, math.inf


def _flat(value: Any, source: _Source, step: int) -> list[float]:
    if value is None or np.shape(value) != source.shape:
        now = "is absent" if value is None else f"has the shape {np.shape(value)}"
        raise RunError(
            f"step {step}: {source.port}.{source.field} {now}, in the first observation it had "
            f"{source.shape}; leave it out with `observe`"
        )
    numbers: list[float] = np.asarray(value, dtype=np.float64).ravel().tolist()
    return numbers


def bounds(fields: Sequence[Field]) -> tuple[Vector, Vector]:
    """Return what no measured value leaves: the efforts' limits, and the stops with some room.

    A joint passes its rated velocity, and leans on its stop.
    """
    low, high = np.full(len(fields), -np.inf), np.full(len(fields), np.inf)
    for index, field in enumerate(fields):
        if field.field in {"position", "effort"} and math.isfinite(field.high - field.low):
            room = 0.1 * (field.high - field.low)
            low[index], high[index] = field.low - room, field.high + room
    return low, high
