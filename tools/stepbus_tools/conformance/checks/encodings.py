"""Checks of how inputs are encoded: unknown fields, numbers, the order of joints."""

import struct
from collections.abc import Callable, Mapping
from typing import Any

import msgpack
import msgspec

from stepbus_orchestrator.analysis.tolerance import FieldTolerance, differences
from stepbus_schemas import Description, Types, encode, json_schema
from stepbus_tools.conformance.kit import Kit, check
from stepbus_tools.conformance.material import edited, reverse_description
from stepbus_tools.conformance.transcript import Skipped, Transcript

_BY_NAME = FieldTolerance(abs=1e-9, rel=1e-9)


@check("P3.4", "it ignores unknown fields in messages", inputs=True)
def _unknown_fields(kit: Kit) -> str:
    extra = msgspec.Raw(msgspec.msgpack.encode({"x": [1, {"y": None}]}))

    def edit(_source: str, _port: str, data: bytes) -> bytes:
        fields = msgspec.msgpack.decode(data)
        return msgspec.msgpack.encode({**fields, "stepbus_conformance": extra})

    kit.unchanged("with unknown fields", edited(kit.feed, edit))
    return "ignored"


@check("P3.4", "it accepts float32 and integers for float64", inputs=True)
def _numbers(kit: Kit) -> str:
    def rounded(source: str, port: str, data: bytes) -> bytes:
        type_name = kit.material.scenario.participant(source).outputs[port].type
        fields = _map_floats(_plain(type_name, data, kit.types), _to_float32)
        return encode(msgspec.convert(fields, kit.types[type_name]))

    feed = edited(kit.feed, rounded)
    expected = kit.play(feed)
    given = kit.play(edited(feed, lambda _s, _p, data: _pack(msgspec.msgpack.decode(data))))
    kit.same(given, "with float32 and integers", expected)
    return "float32 and integers are the same as float64"


def _to_float32(value: float) -> float:
    """Return the nearest float32; small ones, so that some are whole, to a whole number."""
    if abs(value) < 0.3:
        return float(round(value))
    rounded: float = struct.unpack("<f", struct.pack("<f", value))[0]
    return rounded


def _map_floats(value: Any, change: Callable[[float], float]) -> Any:
    if isinstance(value, dict):
        return {key: _map_floats(item, change) for key, item in value.items()}
    if isinstance(value, list):
        return [_map_floats(item, change) for item in value]
    return change(value) if isinstance(value, float) else value


def _pack(value: Any) -> bytes:
    """Return MessagePack with floats as float32, or as integers where they are whole."""
    packed: bytes = msgpack.packb(_map_floats(value, _whole), use_single_float=True)
    return packed


def _whole(value: float) -> float:
    return int(value) if value.is_integer() and str(value) != "-0.0" else value


@check("P4.8", "joints in reverse order give the same values by name", inputs=True)
def _joint_order(kit: Kit) -> str:
    """Give the joints of each input, then of all, in the reverse order."""
    if "P7.2" in kit.reference().problems:
        raise Skipped("its outputs are not of their types; see `content`")
    descriptions = kit.material.descriptions
    items = {
        name: (item.source, item.port)
        for name, item in kit.spec.inputs.items()
        if len(descriptions[name].names) > 1
    }
    if not items:
        raise Skipped("no input has more than one name")
    nameless = [name for name, d in descriptions.items() if not d.names]
    if nameless:
        raise Skipped(f"input {nameless[0]} has no names, so its order is unknown")
    whole = set(items.values())
    sets = [{pair} for pair in dict.fromkeys(items.values())] if kit.knows_names else []
    for pairs in [*sets, *([whole] if len(sets) != 1 else [])]:
        _check_turned(kit, pairs)
    together = "" if kit.knows_names else " together, as raw carries no names"
    return f"{', '.join(items)} in reverse order{together}: the same values by name"


def _check_turned(kit: Kit, pairs: set[tuple[str, str]]) -> None:
    """Raise Failed where some ports, as (source, port), in reverse order give other values."""
    inputs, descriptions = kit.spec.inputs, kit.material.descriptions
    turned = {
        name: reverse_description(d) if (inputs[name].source, inputs[name].port) in pairs else d
        for name, d in descriptions.items()
    }

    def edit(source: str, port: str, data: bytes) -> bytes:
        output = kit.material.scenario.participant(source).outputs[port]
        return _reverse(output.type, data, kit.types) if (source, port) in pairs else data

    expected = _by_name(kit, kit.reference(), descriptions)
    given = _by_name(kit, kit.play(edited(kit.feed, edit), descriptions=turned), turned)
    beyond = [d for d in differences("step", expected, given, _BY_NAME) if d.beyond]
    if beyond:
        which = ", ".join(f"{source}.{port}" for source, port in sorted(pairs))
        kit.differ(
            f"with the joints of {which} in reverse order, {beyond[0].path} is "
            f"{beyond[0].second}, not {beyond[0].first}"
        )


def _by_name(
    kit: Kit, transcript: Transcript, inputs: Mapping[str, Description]
) -> dict[str, dict[str, Any]]:
    """Return all outputs as step → port → field → name → value."""
    described = transcript.readies[0].outputs

    def named(port: str, data: bytes) -> dict[str, Any]:
        type_name = kit.spec.outputs[port].type
        item = described.get(port, Description())
        names = item.names if item.like is None else inputs[item.like].names
        vectors = _vectors_of(type_name, kit.types)
        return {
            key: dict(zip(names, value, strict=True))
            if key in vectors and value and len(value) == len(names)
            else value
            for key, value in _plain(type_name, data, kit.types).items()
        }

    return {
        str(step): {port: named(port, data) for port, data in ports.items()}
        for step, ports in transcript.ports().items()
    }


def _vectors_of(type_name: str, types: Types) -> set[str]:
    """Return the fields of a message type that have one value for each name."""
    fields = json_schema(type_name, types)["properties"]
    return {name for name, field in fields.items() if field.get("shape") == ["n"]}


def _plain(type_name: str, data: bytes, types: Types) -> dict[str, Any]:
    """Return a message as a map of plain values."""
    message = msgspec.msgpack.decode(data, type=types[type_name])
    fields: dict[str, Any] = msgspec.to_builtins(message)
    return fields


def _reverse(type_name: str, data: bytes, types: Types) -> bytes:
    """Return a message with each of its vectors in reversed order."""
    vectors = _vectors_of(type_name, types)
    fields = _plain(type_name, data, types)
    turned = {k: v[::-1] if k in vectors and v else v for k, v in fields.items()}
    return encode(msgspec.convert(turned, types[type_name]))
