"""What a process publishes otherwise than it should, too late or not at all."""

from collections.abc import Callable
from typing import Any

import msgspec

from stepbus_schemas import Batch, Outputs, encode

from .execution import Execution
from .strikes import Arm
from .tape import ORCHESTRATOR, Fault


def on_outputs(change: Callable[[bytes, int], list[bytes]]) -> Arm:
    """Return what changes what a participant publishes at a step, alone or in a batch."""

    def arm(execution: Execution, fault: Fault) -> None:
        step = fault.at - fault.at % execution.every(fault.target)

        def alter(data: bytes) -> list[bytes]:
            if step not in _steps(data):
                return [data]
            execution.struck(fault)
            return change(data, fault.amount)

        execution.alter(fault.target, "out", alter)

    return arm


def on_key(what: str, change: Callable[[bytes, int], list[bytes]]) -> Arm:
    """Return what changes message number `at` that a process sends on such a key."""

    def arm(execution: Execution, fault: Fault) -> None:
        count = 0

        def alter(data: bytes) -> list[bytes]:
            nonlocal count
            count += 1
            if count - 1 != fault.at:
                return [data]
            execution.struck(fault)
            return change(data, fault.amount)

        execution.alter(fault.target, what, alter)

    return arm


def field(name: str, change: Callable[[Any], Any]) -> Callable[[bytes, int], list[bytes]]:
    """Return what changes one field of an envelope."""

    def changed(data: bytes, _amount: int) -> list[bytes]:
        content = msgspec.msgpack.decode(data)
        content[name] = change(content.get(name))
        return [msgspec.msgpack.encode(content)]

    return changed


HELLOS: tuple[tuple[str, Any], ...] = (
    ("protocol", 0),
    ("protocol", 3),
    ("token", "of another run"),
    ("name", "a stranger"),
    ("inputs", {"command": "JointState/1"}),
    ("inputs", {"more": "JointState/1"}),
    ("outputs", {}),
    ("outputs", {"joint_state": "Image/1"}),
    ("types", {"JointState/1": {"name": "JointState", "fields": {}}}),
)


def wrong_hello(data: bytes, amount: int) -> list[bytes]:
    """Return a `Hello` with one field that the scenario does not have so."""
    name, value = HELLOS[amount]
    return field(name, lambda _old: value)(data, amount)


def other_type(_ports: Any) -> Any:
    """Return ports with content of another type."""
    return {port: {"position": "a word", "values": 7} for port in _ports}


def wrong_newest(entries: list[Any] | None) -> list[Any]:
    """Return the outputs of a log, with content of another type in the newest."""
    *before, newest = entries or [None]
    return [] if newest is None else [*before, {**newest, "ports": other_type(newest["ports"])}]


def _steps(data: bytes) -> list[int]:
    """Return the steps of what is published on `out/<name>`."""
    try:
        return [msgspec.msgpack.decode(data, type=Outputs).step]
    except (msgspec.MsgspecError, ValueError):
        pass
    try:
        batch = msgspec.msgpack.decode(data, type=Batch)
    except (msgspec.MsgspecError, ValueError):
        return []
    return [step for entry in batch.outputs for step in _steps(bytes(entry))]


def with_fields(**fields: Callable[[Any, int], Any]) -> Callable[[bytes, int], list[bytes]]:
    """Return what changes fields of outputs."""

    def change(data: bytes, amount: int) -> list[bytes]:
        try:
            outputs = msgspec.msgpack.decode(data, type=Outputs)
        except (msgspec.MsgspecError, ValueError):
            return [data]
        new = {name: make(getattr(outputs, name), amount) for name, make in fields.items()}
        return [encode(msgspec.structs.replace(outputs, **new))]

    return change


def last_words(execution: Execution, fault: Fault) -> None:
    """Kill a process behind a log that it sends, which comes late."""
    network, count = execution.network, 0

    def alter(data: bytes) -> list[bytes]:
        nonlocal count
        count += 1
        if count - 1 == fault.at:
            execution.struck(fault)
            nodes = network.nodes
            link = network.link(nodes[fault.target], nodes[ORCHESTRATOR])
            link.changes[link.count] = "delay", fault.amount
            link.struck[link.count] = lambda: None
            process = nodes[fault.target].process
            process.on_call[process.calls + 1] = process.kill
            execution.world.after(1, process.kill)
        return [data]

    execution.alter(fault.target, "log", alter)


def late_bulk(execution: Execution, fault: Fault) -> None:
    """Let bulk content come late over a link, behind all but other bulk content; 0: never."""
    world, network, count, until_ns = execution.world, execution.network, 0, 0
    source, target = fault.target.split(">")

    def alter(data: bytes) -> list[bytes]:
        nonlocal count, until_ns
        if target not in network.nodes:
            return [data]
        link = network.link(network.nodes[source], network.nodes[target])
        count += 1
        if count - 1 == fault.at:
            execution.struck(fault)
            until_ns = world.now_ns + fault.amount
            if not fault.amount:
                link.changes[link.count] = "drop", 0
        if world.now_ns < until_ns:
            link.changes[link.count] = "late", until_ns - world.now_ns
        link.struck.setdefault(link.count, lambda: None)
        return [data]

    execution.alter(source, "bulk", alter)
