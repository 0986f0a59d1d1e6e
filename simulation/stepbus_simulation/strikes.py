"""How faults strike a simulated run: what is done to its links, processes, messages and disk."""

import os
import shutil
from collections.abc import Callable
from typing import Any

import msgspec

from stepbus_schemas import Batch, Outputs, encode

from .execution import Execution
from .network import Link
from .tape import ORCHESTRATOR, Fault
from .world import Process

Arm = Callable[[Execution, Fault], None]
Change = Callable[[bytes, int], list[bytes]]
"""Takes a message and the amount of a fault, and returns the messages to send instead."""


def by_run(_execution: Execution, _fault: Fault) -> None:
    """Do nothing: the run injects it, as with `--fault`."""


# --- links ----------------------------------------------------------------------------------


def on_message(what: str) -> Arm:
    """Return what becomes of message number `at` of a link."""

    def arm(execution: Execution, fault: Fault) -> None:
        def change(link: Link) -> None:
            link.changes[fault.at] = what, fault.amount
            link.struck[fault.at] = lambda: execution.struck(fault)

        execution.on_link(fault.target, change)

    return arm


def late_link(execution: Execution, fault: Fault) -> None:
    """Let the connection of two processes, which carries both ways, come up late."""
    one, other = fault.target.split(">")

    def delay(link: Link) -> None:
        up_ns = execution.world.now_ns + fault.amount
        link.up_ns = execution.network.up_ns.setdefault(frozenset({one, other}), up_ns)
        execution.struck(fault)

    for name in (f"{one}>{other}", f"{other}>{one}"):
        execution.on_link(name, delay)


def cut(execution: Execution, fault: Fault) -> None:
    """Close the connection of two processes for a time."""
    world, network = execution.world, execution.network
    one, other = fault.target.split(">")

    def begin() -> None:
        if network.connect(one, other, is_up=False):
            execution.struck(fault)
            world.after(fault.amount, end)

    def end() -> None:
        network.connect(one, other, is_up=True)

    world.after(fault.at, begin)


# --- processes and the machine --------------------------------------------------------------


def at_call(act: Callable[[Execution, Fault, Process], None]) -> Arm:
    """Return what strikes a process between two of its system calls."""

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


def deaf(execution: Execution, fault: Fault) -> None:
    """Stop a process once it is asked to end."""

    def alter(data: bytes) -> list[bytes]:
        process = execution.process(fault.target)
        if process is not None and not process.is_dead and not process.is_frozen:
            execution.struck(fault)
            freeze(execution, fault, process)
        return [data]

    execution.alter(ORCHESTRATOR, "stop", alter)


def of_host(setting: str) -> Arm:
    """Return what changes a setting of the host for one process: its start, end or exit code."""

    def arm(execution: Execution, fault: Fault) -> None:
        getattr(execution.host, setting)[fault.target] = fault.amount
        execution.struck(fault)

    return arm


def in_step(act: Callable[[Process, Fault], None]) -> Arm:
    """Return what happens to a participant in the midst of a step."""

    def arm(execution: Execution, fault: Fault) -> None:
        def strike() -> None:
            process = execution.process(fault.target)
            assert process is not None
            execution.struck(fault)
            act(process, fault)

        execution.in_step(fault.target, fault.at, strike)

    return arm


def raise_error(_process: Process, _fault: Fault) -> None:
    """Raise an error."""
    raise ValueError("struck")


def end_process(process: Process, fault: Fault) -> None:
    """End the process at once."""
    process.kill(fault.amount)


def compute_long(process: Process, fault: Fault) -> None:
    """Let a step take long."""
    process.clock.sleep(fault.amount / 1e9)


def ignore_triggers(execution: Execution, fault: Fault) -> None:
    """Let a participant read no triggers from a step on."""

    def strike() -> None:
        execution.struck(fault)
        node = execution.network.nodes[fault.target]
        node.declared = [row for row in node.declared if row[:2] != ("subscriber", "trigger")]
        execution.network.changes += 1

    execution.in_step(fault.target, fault.at, strike)


def at_time(act: Arm, *, while_recorded: bool = False) -> Arm:
    """Return what strikes the machine at a time, or a run, where that still records."""

    def arm(execution: Execution, fault: Fault) -> None:
        def strike() -> None:
            is_over = execution.orchestrator.is_dead or execution.watch.is_recorded
            if not (while_recorded and is_over):
                execution.struck(fault)
                act(execution, fault)

        execution.world.after(fault.at, strike)

    return arm


def sleep(execution: Execution, fault: Fault) -> None:
    """Let the whole machine sleep."""
    execution.world.now_ns += fault.amount


def wall(execution: Execution, fault: Fault) -> None:
    """Let the time of day jump."""
    execution.world.wall_ns += fault.amount


def interrupt(execution: Execution, _fault: Fault) -> None:
    """Interrupt the run, as Ctrl-C does."""
    execution.interrupt.set()


def remove_folder(execution: Execution, _fault: Fault) -> None:
    """Remove the folder of the run."""
    shutil.rmtree(execution.out, ignore_errors=True)


# --- messages -------------------------------------------------------------------------------


def lost(_data: bytes, _amount: int) -> list[bytes]:
    """Return no message."""
    return []


def field(name: str, change: Callable[[Any], Any]) -> Change:
    """Return what changes one field of an envelope."""

    def changed(data: bytes, _amount: int) -> list[bytes]:
        content = msgspec.msgpack.decode(data)
        content[name] = change(content.get(name))
        return [msgspec.msgpack.encode(content)]

    return changed


def on_outputs(name: str, make: Callable[[Any, int], Any]) -> Arm:
    """Return what changes a field of the outputs that a participant publishes at a step.

    They go alone or in a batch.
    """

    def arm(execution: Execution, fault: Fault) -> None:
        step = fault.at - fault.at % execution.every(fault.target)

        def alter(data: bytes) -> list[bytes]:
            if step not in _steps(data):
                return [data]
            execution.struck(fault)
            try:
                outputs = msgspec.msgpack.decode(data, type=Outputs)
            except (msgspec.MsgspecError, ValueError):
                return [data]
            new = make(getattr(outputs, name), fault.amount)
            return [encode(msgspec.structs.replace(outputs, **{name: new}))]

        execution.alter(fault.target, "out", alter)

    return arm


def on_key(what: str, change: Change) -> Arm:
    """Return what changes message number `at` that a process sends on such a key."""

    def arm(execution: Execution, fault: Fault) -> None:
        def alter(data: bytes) -> list[bytes]:
            execution.struck(fault)
            return change(data, fault.amount)

        _alter_one(execution, fault, what, alter)

    return arm


def _alter_one(
    execution: Execution, fault: Fault, what: str, act: Callable[[bytes], list[bytes]]
) -> None:
    """Let a function return what is sent instead of message number `at` on such a key."""
    count = 0

    def alter(data: bytes) -> list[bytes]:
        nonlocal count
        count += 1
        return act(data) if count - 1 == fault.at else [data]

    execution.alter(fault.target.partition(">")[0], what, alter)


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


def other_type(ports: Any, _amount: int = 0) -> Any:
    """Return ports with content of another type."""
    return {port: {"position": "a word", "values": 7} for port in ports}


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


def last_words(execution: Execution, fault: Fault) -> None:
    """Kill a process after a log that it sends, which comes late."""

    def alter(data: bytes) -> list[bytes]:
        execution.struck(fault)
        nodes = execution.network.nodes
        link = execution.network.link(nodes[fault.target], nodes[ORCHESTRATOR])
        link.changes[link.count] = "delay", fault.amount
        link.struck[link.count] = lambda: None
        process = nodes[fault.target].process
        process.on_call[process.calls + 1] = process.kill
        execution.world.after(1, process.kill)
        return [data]

    _alter_one(execution, fault, "log", alter)


def late_bulk(execution: Execution, fault: Fault) -> None:
    """Let bulk content come late over a link, after all but other bulk content; 0: never."""
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


# --- the disk -------------------------------------------------------------------------------


def _disk(
    execution: Execution, fault: Fault, strike: Callable[[str, int], int], count: int
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
                return strike(name, size)
        return size

    execution.disk.strike = struck


def raising(number: int) -> Arm:
    """Return what lets `amount` calls of the disk fail; 0: one."""

    def strike(_name: str, _size: int) -> int:
        raise OSError(number, os.strerror(number))

    def arm(execution: Execution, fault: Fault) -> None:
        _disk(execution, fault, strike, fault.amount or 1)

    return arm


def short(execution: Execution, fault: Fault) -> None:
    """Let a write take only a part."""
    _disk(execution, fault, lambda _name, size: min(size, max(1, fault.amount)), 1)


def power(execution: Execution, fault: Fault) -> None:
    """Let the machine lose its power: what is being written is torn, what is renamed is not."""

    def strike(name: str, size: int) -> int:
        if name == "replace":
            execution.orchestrator.kill()
        return size * fault.amount // 1000

    def done(_name: str) -> None:
        if fault in execution.effective:
            execution.orchestrator.kill()

    _disk(execution, fault, strike, 1)
    execution.disk.done = done
