"""Format `raw`: blocks of little-endian float64, for programs without a codec."""

import math
import struct
from collections.abc import Mapping, Sequence

from stepbus_bridge.bridge import Bridge, Described
from stepbus_participant import Config, Step
from stepbus_schemas import (
    BRIDGE_VERSION,
    Description,
    Message,
    RawLayout,
    RunError,
    WiringError,
    raw_problem,
)

Row = list[float]
_LACKING = {"names": "joints", "shape": "length"}


class RawBridge(Bridge):
    """A participant whose program speaks numbers alone."""

    def __init__(self, config: Config, argv: Sequence[str], form: str, describe: Described) -> None:
        inputs = {name: port.type for name, port in config.inputs.items()}
        outputs = {name: port.type for name, port in config.outputs.items()}
        if mistake := raw_problem(config.publishes, inputs, outputs, config.types):
            raise WiringError(f"participants.{config.name}.bridge: {mistake}")
        super().__init__(config, argv, form, describe, lambda _: self._codes[1].size)
        self._in: list[tuple[str, RawLayout, Sequence[int]]] = []
        self._out: list[tuple[str, RawLayout]] = []
        # The program's first number says that it is ready.
        self._codes = (struct.Struct(""), struct.Struct("<d"))

    def describe(self) -> Mapping[str, Description]:
        """Wait until the program has written its 1.0."""
        (ready,) = struct.unpack("<d", self.program.receive())
        if ready != 1.0:
            raise self.program.wrong(f"wrote {ready!r} instead of 1.0 as its ready signal")
        return self._described

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Send the header, now that the number of joints is known."""
        named = next((len(row.names) for row in inputs.values() if row.names), 0)
        outputs = {name: self._description(name, inputs) for name in self.config.outputs}
        wanted = next((row.names for row in outputs.values() if row.names), [])
        for name, port in self.config.inputs.items():
            row = inputs[name]
            layout = self._layout(port.type, row, len(row.names) or named)
            for key in layout.lacks():
                raise WiringError(
                    f"format raw needs the {_LACKING[key]} of input {name!r}; {port.source} must "
                    f"describe its {port.port!r} with {key}"
                )
            self._in.append((name, layout, _order(row.names, wanted)))
        for name, row in outputs.items():
            layout = self._layout(self.config.outputs[name].type, row, len(row.names))
            for key in layout.lacks():
                raise WiringError(
                    f"participants.{self.config.name}.bridge: format raw needs the "
                    f"{_LACKING[key]} of {name!r}; add describe: {{{name}: {{{key}: […]}}}}"
                )
            self._out.append((name, layout))
        n_in = 2 + sum(1 + layout.width for _, layout, _ in self._in)
        n_out = sum(layout.width for _, layout in self._out)
        self._codes = (struct.Struct(f"<{n_in}d"), struct.Struct(f"<{n_out}d"))
        header = self._header(n_in, n_out)
        self.program.send(struct.pack(f"<{len(header)}d", *header))

    def _layout(self, type_name: str, description: Description, names: int) -> RawLayout:
        length = description.shape[0] if description.shape else 0
        return RawLayout(type_name, self.config.types, names=names, length=length)

    def _description(self, output: str, inputs: Mapping[str, Description]) -> Description:
        description = self._described.get(output, Description())
        return description if description.like is None else inputs[description.like]

    def _header(self, n_in: int, n_out: int) -> Row:
        config = self.config
        params = [
            value
            for value in config.params.values()
            if isinstance(value, int | float) and not isinstance(value, bool)
        ]
        sizes = (config.every, 0, n_in, n_out, config.seed, len(params))
        return [BRIDGE_VERSION, config.step_ns * 1e-9, *sizes, *params]

    def update(self, step: Step) -> Mapping[str, Message]:
        """Send the inputs of a step to the program and return its outputs."""
        numbers: Row = [float(step.index), step.t]
        for name, layout, order in self._in:
            message = step.get(name)
            numbers.append(float(message is not None))
            try:
                numbers += (
                    [math.nan] * layout.width if message is None else layout.flatten(message, order)
                )
            except ValueError as exc:
                raise RunError(f"input {name!r}: {exc}") from exc
        pack, unpack = self._codes
        answer = unpack.unpack(self.program.ask(pack.pack(*numbers)))
        messages: dict[str, Message] = {}
        start = 0
        for name, layout in self._out:
            end = start + layout.width
            try:
                messages[name] = layout.unflatten(answer[start:end])
            except ValueError as exc:
                raise self.program.wrong(f"gave an invalid answer: {name}: {exc}") from exc
            start = end
        return messages


def _order(names: Sequence[str], wanted: Sequence[str]) -> Sequence[int]:
    """Return the index in `names` of each `wanted` joint; empty where the order is the same."""
    if list(names) == list(wanted) or sorted(names) != sorted(wanted):
        return ()
    return [names.index(name) for name in wanted]
