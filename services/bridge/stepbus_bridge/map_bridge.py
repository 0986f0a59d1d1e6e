"""Formats `json` and `msgpack`: a map for each message."""

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import astuple

from stepbus_bridge.bridge import Bridge, BridgeError, Described, show
from stepbus_participant import Config, Step
from stepbus_schemas import BRIDGE_VERSION, Description, Message, Types, WiringError, explained

_to_json = msgspec.json.Encoder().encode
_to_msgpack = msgspec.msgpack.Encoder().encode
_BROKEN = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)


class _Descriptions(msgspec.Struct):
    outputs: dict[str, Description] = {}
    versions: dict[str, str] = {}
    types: dict[str, dict[str, Any]] = {}


class _Ready(msgspec.Struct):
    ready: _Descriptions


class Json:
    """One line of JSON. NaN and infinity are `null`; in a list, `null` may be a NaN."""

    def length(self, data: bytes | bytearray) -> int:
        """Return the length of the first line; -1: it has no end yet."""
        return data.find(b"\n") + 1 or -1

    def encode(self, value: Any) -> bytes:
        """Return a framed message."""
        return _to_json(value) + b"\n"

    def decoder(self, cls: type[Any]) -> Any:
        """Return a function from a framed message to a value; it raises msgspec's errors."""
        quick = msgspec.json.Decoder(cls).decode

        def decode(data: bytes) -> Any:
            try:
                return quick(data)
            except msgspec.ValidationError:
                return msgspec.convert(_with_nan(msgspec.json.decode(data)), cls)

        return decode


def _with_nan(value: Any) -> Any:
    """Return plain data with a NaN for every null in a list."""
    if isinstance(value, dict):
        return {key: _with_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [float("nan") if item is None else _with_nan(item) for item in value]
    return value


class MessagePack:
    """An unsigned 32-bit little-endian length, then a MessagePack map of as many bytes."""

    def length(self, data: bytes | bytearray) -> int:
        """Return the length of the first message, with its prefix; -1: not yet known."""
        return 4 + int.from_bytes(data[:4], "little") if len(data) >= 4 else -1

    def encode(self, value: Any) -> bytes:
        """Return a framed message."""
        data = _to_msgpack(value)
        return len(data).to_bytes(4, "little") + data

    def decoder(self, cls: type[Any]) -> Any:
        """Return a function from a framed message to a value; it raises msgspec's errors."""
        decode = msgspec.msgpack.Decoder(cls).decode
        return lambda data: decode(memoryview(data)[4:])


class MapBridge(Bridge):
    """A participant whose program speaks JSON or MessagePack."""

    def __init__(self, config: Config, argv: Sequence[str], form: str, describe: Described) -> None:
        self._codec = Json() if form == "json" else MessagePack()
        super().__init__(config, argv, form, describe, self._codec.length)
        self._first = config.publishes == "first"
        self._ports = tuple(config.inputs)
        self._outputs = tuple(config.outputs)
        classes = {port: config.types[row.type] for port, row in config.outputs.items()}
        self._answer = _answer(classes)
        self._decode = self._codec.decoder(self._answer)
        self._versions: Mapping[str, str] = {}

    def describe(self) -> Mapping[str, Description]:
        """Send the program the `welcome`; return how it describes its outputs."""
        self.program.send(self._codec.encode({"welcome": _welcome(self.config)}))
        answer: _Ready = self._read(self._codec.decoder(_Ready), self.program.receive())
        self._versions = answer.ready.versions
        declared = Types(answer.ready.types)
        for text in declared.misfits(self.config.types, "the program", "the scenario"):
            # A type that it declares differently (P14.5).
            raise WiringError(f"{self.program}: {text}")
        return {**self._described, **answer.ready.outputs}

    def versions(self) -> Mapping[str, str]:
        """Return the versions of the program's libraries."""
        return self._versions

    def start(self, inputs: Mapping[str, Description]) -> None:
        """Send the program the descriptions of its inputs."""
        self.program.send(self._codec.encode({"start": {"inputs": dict(inputs)}}))

    def output(self, step: Step) -> Mapping[str, Message]:
        """Ask the program for its outputs before its inputs."""
        return self._ask({"output": {"step": step.index, "t_ns": step.t_ns}}, step, True)

    def update(self, step: Step) -> Mapping[str, Message]:
        """Send the inputs of a step to the program and return its outputs."""
        get, is_new = step.get, step.is_new
        update = {
            "step": step.index,
            "t_ns": step.t_ns,
            "inputs": {port: get(port) for port in self._ports},
            "new": [port for port in self._ports if is_new(port)],
        }
        return self._ask({"update": update}, step, not self._first)

    def _ask(self, message: Mapping[str, Any], step: Step, publishes: bool) -> dict[str, Message]:
        """Return the outputs in the answer to a message. publishes: whether there may be any."""
        answer = self._read(self._decode, self.program.ask(self._codec.encode(message)))
        messages: dict[str, Message] = {}
        if answer.outputs is not None:
            messages = dict(zip(self._outputs, astuple(answer.outputs), strict=True))
            if None in messages.values():
                messages = {port: value for port, value in messages.items() if value is not None}
        if answer.end is not None:
            step.end(answer.end)
        if messages and not publishes:
            raise self.program.wrong(
                "publishes first: it must answer `output` with its outputs and `update` without any"
            )
        return messages

    def _read(self, decode: Any, data: bytes | bytearray) -> Any:
        try:
            return decode(data)
        except _BROKEN as exc:
            raise self._malformed(exc, data) from exc

    def _malformed(self, exc: Exception, data: bytes | bytearray) -> BridgeError:
        known = ", ".join(f"{port} ({row.type})" for port, row in self.config.outputs.items())
        if isinstance(exc, msgspec.ValidationError):
            text = explained(exc, self._answer)
            return self.program.wrong(
                f"gave an invalid answer: {text}; its outputs are {known or 'none'}"
            )
        return self.program.wrong(f"wrote {show(data)}: {explained(exc)}")


def _answer(classes: Mapping[str, type[Message]]) -> type[msgspec.Struct]:
    """Return the type of an answer. classes: output → type of its message."""
    # Outputs may have names that no field can have.
    names = {f"port{n}": port for n, port in enumerate(classes)}
    outputs = msgspec.defstruct(
        "Outputs",
        [(field, classes[port] | None, None) for field, port in names.items()],
        rename=names,
        forbid_unknown_fields=True,
        gc=False,
    )
    fields = [("outputs", outputs | None, None), ("end", str | None, None)]
    return msgspec.defstruct("Answer", fields, gc=False)


def _welcome(config: Config) -> dict[str, Any]:
    return {
        "protocol": BRIDGE_VERSION,
        "name": config.name,
        "step_ns": config.step_ns,
        "every": config.every,
        "publishes": config.publishes,
        "seed": config.seed,
        "folder": str(config.folder),
        "params": config.params,
        "inputs": {
            name: {"type": port.type, "source": port.source, "delay": port.delay}
            for name, port in config.inputs.items()
        },
        "outputs": {name: {"type": port.type} for name, port in config.outputs.items()},
        **({"types": config.types.declarations} if config.types.declarations else {}),
    }
