"""Format `raw`: blocks of little-endian float64, for programs without a codec."""

import math
import struct
from collections.abc import Mapping, Sequence

from stepbus_participant import Config, Step
from stepbus_schemas import (
    PROTOCOL_VERSION,
    Description,
    JointCommand,
    JointMode,
    JointReference,
    JointState,
    Message,
    RunError,
    WiringError,
    raw_problem,
)

from .bridge import Bridge, BridgedProgram

Row = list[float]
_MODES: tuple[JointMode, ...] = ("torque", "velocity", "position", "teleport", "brake")
_VECTORS = {
    "JointCommand/1": ("values",),
    "JointReference/1": ("position", "velocity", "acceleration"),
    "JointState/1": ("position", "velocity", "effort"),
}


def width(type_name: str, n: int) -> int:
    """Return how many numbers a message of `n` joints has."""
    return (type_name == "JointCommand/1") + n * len(_VECTORS[type_name])


def flatten(message: Message, type_name: str, n: int, order: Sequence[int] = ()) -> Row:
    """Return the numbers of a message; raises RunError where it is not of `n` joints.

    order: index of the entry of each vector that comes first, second …; empty: unchanged.
    """
    numbers: Row = [float(_MODES.index(message.mode))] if isinstance(message, JointCommand) else []
    for name in _VECTORS[type_name]:
        vector = getattr(message, name)
        if vector is not None and len(vector) != n:
            raise RunError(f"{name} has {len(vector)} numbers for {n} joints")
        if vector is None:
            numbers += [math.nan] * n
        else:
            numbers += [vector[i] for i in order] if order else vector
    return numbers


def unflatten(numbers: Sequence[float], type_name: str, n: int) -> Message:
    """Return the message of `n` joints that numbers stand for; raises ValueError for no mode."""
    if type_name == "JointCommand/1":
        if numbers[0] not in range(len(_MODES)):
            raise ValueError(f"mode {numbers[0]:g} is none of 0 (torque) … 4 (brake)")
        return JointCommand(mode=_MODES[int(numbers[0])], values=list(numbers[1:]))
    first, second, third = (list(numbers[i : i + n]) for i in range(0, 3 * n, n))
    if type_name == "JointReference/1":
        return JointReference(position=first, velocity=second, acceleration=third)
    sensed = (None if all(map(math.isnan, row)) else row for row in (first, second, third))
    return JointState(**dict(zip(_VECTORS[type_name], sensed, strict=True)))


class Block:
    """Always the same number of float64; `count` may change between two messages."""

    count = 1

    def length(self, _data: bytes | bytearray) -> int:
        """Return the length of a message."""
        return 8 * self.count

    def progress(self, data: bytes | bytearray) -> str:
        """Return in words how much of a message `data` is."""
        return f"{len(data)} of {8 * self.count} bytes ({self.count} numbers)"


class RawBridge(Bridge):
    """A participant whose program speaks numbers alone."""

    def __init__(self, config: Config, bridged: BridgedProgram) -> None:
        _check(config)
        self._block = Block()
        super().__init__(config, bridged, self._block)
        self._in: list[tuple[str, str, int, Sequence[int]]] = []
        self._out: list[tuple[str, str, int]] = []
        self._codes = (struct.Struct(""), struct.Struct(""))

    def describe(self) -> Mapping[str, Description]:
        """Wait until the program has written its 1.0."""
        (ready,) = struct.unpack("<d", self.link.receive())
        if ready != 1.0:
            raise self.link.wrong(f"wrote {ready!r}, not 1.0, to say that it is ready")
        return self._described

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Send the header, now that the number of joints is known."""
        named = next((len(row.names) for row in inputs.values() if row.names), 0)
        joints = [self._joints(name, inputs) for name in self.config.outputs]
        for name, port in self.config.inputs.items():
            n = len(inputs[name].names) or named
            if not n:
                raise WiringError(
                    f"raw has to know the joints of input {name!r}; let {port.source} describe "
                    f"its {port.port!r} with names"
                )
            self._in.append((name, port.type, n, _order(inputs[name].names, joints[0])))
        for (name, row), names in zip(self.config.outputs.items(), joints, strict=True):
            self._out.append((name, row.type, len(names)))
        n_in = 2 + sum(1 + width(type_name, n) for _, type_name, n, _ in self._in)
        n_out = sum(width(type_name, n) for _, type_name, n in self._out)
        self._block.count = n_out
        self._codes = (struct.Struct(f"<{n_in}d"), struct.Struct(f"<{n_out}d"))
        header = self._header(n_in, n_out)
        self.link.send(struct.pack(f"<{len(header)}d", *header))

    def _joints(self, output: str, inputs: Mapping[str, Description]) -> Sequence[str]:
        """Return the joints of an output; raises WiringError where they are not known."""
        description = self._described.get(output, Description())
        names = description.names if description.like is None else inputs[description.like].names
        if not names:
            raise WiringError(
                f"participants.{self.config.name}.bridge: raw has to know the joints of "
                f"{output!r}; write describe: {{{output}: {{names: […]}}}}"
            )
        return names

    def _header(self, n_in: int, n_out: int) -> Row:
        config = self.config
        params = [
            float(value)
            for value in config.params.values()
            if isinstance(value, int | float) and not isinstance(value, bool)
        ]
        dt = config.step_ns * 1e-9
        rest = (config.every, 0, n_in, n_out, config.seed, len(params))
        return [float(PROTOCOL_VERSION), dt, *map(float, rest), *params]

    def update(self, step: Step) -> Mapping[str, Message]:
        """Send the inputs of a step to the program and return its outputs."""
        numbers: Row = [float(step.index), step.t]
        for name, type_name, n, order in self._in:
            message = step.get(name)
            numbers.append(float(message is not None))
            try:
                numbers += (
                    [math.nan] * width(type_name, n)
                    if message is None
                    else flatten(message, type_name, n, order)
                )
            except RunError as exc:
                raise RunError(f"input {name!r}: {exc}") from exc
        pack, unpack = self._codes
        answer = unpack.unpack(self.link.ask(pack.pack(*numbers)))
        return self._messages(answer)

    def _messages(self, numbers: Sequence[float]) -> dict[str, Message]:
        found: dict[str, Message] = {}
        start = 0
        for name, type_name, n in self._out:
            end = start + width(type_name, n)
            try:
                found[name] = unflatten(numbers[start:end], type_name, n)
            except ValueError as exc:
                raise self.link.wrong(f"answered wrongly: {name}: {exc}") from exc
            start = end
        return found


def _order(names: Sequence[str], wanted: Sequence[str]) -> Sequence[int]:
    """Return the index in `names` of each `wanted` joint; empty where the order is the same."""
    if list(names) == list(wanted) or sorted(names) != sorted(wanted):
        return ()
    return [names.index(name) for name in wanted]


def _check(config: Config) -> None:
    """Raise WiringError for what numbers alone cannot carry."""
    inputs = {name: port.type for name, port in config.inputs.items()}
    outputs = {name: port.type for name, port in config.outputs.items()}
    mistake = raw_problem(config.publishes, inputs, outputs)
    if mistake:
        raise WiringError(f"participants.{config.name}.bridge: {mistake}")
