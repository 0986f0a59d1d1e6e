"""How faults strike a simulated run: what is done to its links, processes, messages and disk."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import msgspec

from stepbus_schemas import Batch, Outputs, encode

from .network import Link
from .tape import ORCHESTRATOR, Fault
from .world import Process

if TYPE_CHECKING:
    from .execution import Execution

# --- links ----------------------------------------------------------------------------------


def on_message(what: str) -> Callable[[Execution, Fault], None]:
    """Return what becomes of message number `at` of a link."""

    def arm(execution: Execution, fault: Fault) -> None:
        def change(link: Link) -> None:
            link.changes[fault.at] = what, fault.amount
            link.struck[fault.at] = lambda: execution.struck(fault)

        execution.on_link(fault.target, change)

    return arm


def late_bulk(execution: Execution, fault: Fault) -> None:
    """Let bulk content come late, behind all but other bulk content."""
    world, network, count, until_ns = execution.world, execution.network, 0, 0

    def alter(data: bytes) -> list[bytes]:
        nonlocal count, until_ns
        count += 1
        if count - 1 == fault.at:
            execution.struck(fault)
            until_ns = world.now_ns + fault.amount
        for (source, _), link in network.links.items():
            if source == fault.target and world.now_ns < until_ns:
                link.changes[link.count] = "late", until_ns - world.now_ns
                link.struck[link.count] = lambda: None
        return [data]

    execution.alter(fault.target, "bulk", alter)


def late_link(execution: Execution, fault: Fault) -> None:
    """Let the connection of two processes, which carries both ways, come up late."""

    def delay(link: Link) -> None:
        network = execution.network
        key = frozenset(fault.target.split(">"))
        link.up_ns = network.up_ns.setdefault(key, execution.world.now_ns + fault.amount)
        execution.struck(fault)

    for name in _both_ways(fault.target):
        execution.on_link(name, delay)


def cut(execution: Execution, fault: Fault) -> None:
    """Close the connection of two processes for a time."""
    world, network = execution.world, execution.network
    one, other = fault.target.split(">")

    def begin() -> None:
        if network.cut(one, other):
            execution.struck(fault)
            world.after(fault.amount, lambda: network.heal(one, other))

    world.after(fault.at, begin)


def _both_ways(target: str) -> tuple[str, str]:
    one, other = target.split(">")
    return f"{one}>{other}", f"{other}>{one}"


# --- processes ------------------------------------------------------------------------------


def at_time(
    act: Callable[[Execution, Fault, Process], None],
) -> Callable[[Execution, Fault], None]:
    """Return what strikes a process at a time, if it is there then."""

    def arm(execution: Execution, fault: Fault) -> None:
        def strike() -> None:
            process = execution.process(fault.target)
            if process is not None and not process.is_dead:
                execution.struck(fault)
                act(execution, fault, process)

        execution.world.after(fault.at, strike)

    return arm


def at_call(
    act: Callable[[Execution, Fault, Process], None],
) -> Callable[[Execution, Fault], None]:
    """Return what strikes a process between two of its calls of the machine."""

    def arm(execution: Execution, fault: Fault) -> None:
        def on_started(process: Process) -> None:
            def strike() -> None:
                execution.struck(fault)
                act(execution, fault, process)

            process.on_call[fault.at] = strike

        execution.when_started(fault.target, on_started)

    return arm


def kill(_execution: Execution, fault: Fault, process: Process) -> None:
    """End a process by a signal."""
    process.kill(-fault.amount)


def freeze(execution: Execution, fault: Fault, process: Process) -> None:
    """Stop a process, for a time or for good: as long as there is an orchestrator to notice."""
    if execution.orchestrator.is_dead:
        return
    if fault.amount:
        execution.world.after(fault.amount, process.thaw)
    process.freeze()


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


def deaf(execution: Execution, fault: Fault) -> None:
    """Stop a process once it is asked to end."""

    def alter(data: bytes) -> list[bytes]:
        process = execution.process(fault.target)
        if process is not None and not process.is_dead and not process.is_frozen:
            execution.struck(fault)
            freeze(execution, fault, process)
        return [data]

    execution.alter(ORCHESTRATOR, "stop", alter)


def slow_start(execution: Execution, fault: Fault) -> None:
    """Let a process take long before its first line."""
    execution.host.start_ns[fault.target] = fault.amount
    execution.struck(fault)


def linger(execution: Execution, fault: Fault) -> None:
    """Let a process take long for its end."""
    execution.host.linger_ns[fault.target] = fault.amount
    execution.struck(fault)


def lie(execution: Execution, fault: Fault) -> None:
    """Let a process end with another exit code."""
    execution.host.lies[fault.target] = fault.amount
    execution.struck(fault)


def in_step(
    act: Callable[[Process, Fault], None],
) -> Callable[[Execution, Fault], None]:
    """Return what happens to a participant in the midst of a step."""

    def arm(execution: Execution, fault: Fault) -> None:
        def strike() -> None:
            process = execution.process(fault.target)
            assert process is not None
            execution.struck(fault)
            act(process, fault)

        execution.in_step(fault.target, fault.at, strike)

    return arm


def ignore_triggers(execution: Execution, fault: Fault) -> None:
    """Let a participant read no triggers from a step on."""

    def strike() -> None:
        execution.struck(fault)
        node = execution.network.nodes[fault.target]
        node.subscribers = [row for row in node.subscribers if row[0] != "trigger"]
        execution.network.changes += 1

    execution.in_step(fault.target, fault.at, strike)


def raise_error(_process: Process, _fault: Fault) -> None:
    """Raise an error."""
    raise ValueError("struck")


def end_process(process: Process, fault: Fault) -> None:
    """End the process at once."""
    process.kill(fault.amount)


def compute_long(process: Process, fault: Fault) -> None:
    """Let a step take long."""
    process.clock.sleep(fault.amount / 1e9)


def sleep(execution: Execution, fault: Fault) -> None:
    """Let the whole machine sleep."""

    def strike() -> None:
        execution.struck(fault)
        execution.world.now_ns += fault.amount

    execution.world.after(fault.at, strike)


def wall(execution: Execution, fault: Fault) -> None:
    """Let the time of day jump."""

    def strike() -> None:
        execution.struck(fault)
        execution.world.wall_ns += fault.amount

    execution.world.after(fault.at, strike)


def interrupt(execution: Execution, fault: Fault) -> None:
    """Interrupt the run, as Ctrl-C does."""

    def strike() -> None:
        if not execution.orchestrator.is_dead and not execution.is_recorded:
            execution.struck(fault)
            execution.interrupt.set()

    execution.world.after(fault.at, strike)


# --- what a participant publishes -----------------------------------------------------------


def on_outputs(change: Callable[[bytes, int], list[bytes]]) -> Callable[[Execution, Fault], None]:
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


def on_key(
    what: str, change: Callable[[bytes, int], list[bytes]]
) -> Callable[[Execution, Fault], None]:
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
    ("protocol", 1),
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


# --- the disk -------------------------------------------------------------------------------


def _disk(
    execution: Execution, fault: Fault, strike: Callable[[int, str, int], int], count: int
) -> None:
    """Let calls number `at` to `at + count` of the disk go wrong; target: the name of the call."""
    before, calls = execution.disk.strike, 0

    def struck(name: str, size: int) -> int:
        nonlocal calls
        size = before(name, size)
        if fault.target in {"", name}:
            calls += 1
            if 0 <= calls - 1 - fault.at < count:
                execution.struck(fault)
                return strike(calls, name, size)
        return size

    execution.disk.strike = struck


def raising(number: int, count: int | None) -> Callable[[Execution, Fault], None]:
    """Return what lets calls of the disk fail."""

    def strike(_number: int, _name: str, _size: int) -> int:
        raise OSError(number, os.strerror(number))

    def arm(execution: Execution, fault: Fault) -> None:
        _disk(execution, fault, strike, fault.amount if count is None else count)

    return arm


def short(execution: Execution, fault: Fault) -> None:
    """Let a write take only a part."""
    _disk(execution, fault, lambda _n, _name, size: min(size, max(1, fault.amount)), 1)


def folder(execution: Execution, fault: Fault) -> None:
    """Remove the folder of the run."""

    def strike() -> None:
        if not execution.orchestrator.is_dead and not execution.is_recorded:
            execution.struck(fault)
            shutil.rmtree(execution.out, ignore_errors=True)

    execution.world.after(fault.at, strike)


def power(execution: Execution, fault: Fault) -> None:
    """Let the machine lose its power: what is being written is torn, what is renamed is not."""

    def strike(_number: int, name: str, size: int) -> int:
        if name == "replace":
            execution.orchestrator.kill()
        return size * fault.amount // 1000

    def done(_name: str) -> None:
        if fault in execution.effective:
            execution.orchestrator.kill()

    _disk(execution, fault, strike, 1)
    execution.disk.done = done
