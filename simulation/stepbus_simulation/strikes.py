"""How faults strike a simulated run: what is done to its links, processes, messages and disk."""

import os
import shutil
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec

from stepbus_schemas import Outputs, encode

from .execution import Execution
from .network import Link, Parcel
from .tape import Fault

Arm = Callable[[Execution, Fault], None]
Change = Callable[[Link, Parcel, int], list[Parcel]]
"""Takes a link, what it was to carry and the amount of a fault; returns what it carries."""


def by_run(_execution: Execution, _fault: Fault) -> None:
    """Do nothing: the run injects it, as with `--fault`."""


# --- messages -------------------------------------------------------------------------------


def on_message(key: str, change: Change, *, more: bool = False) -> Arm:
    """Return what becomes of message number `at` with a key on a link, or on all of a process.

    more: and of all messages after it.
    """

    def arm(execution: Execution, fault: Fault) -> None:
        counts: Counter[Link] = Counter()

        def changed(link: Link, parcel: Parcel) -> list[Parcel]:
            counts[link] += 1
            number = counts[link] - 1
            if number != fault.at and not (more and number > fault.at):
                return [parcel]
            execution.struck(fault)
            return change(link, parcel, fault.amount)

        source, _, target = fault.target.partition(">")
        execution.on_message(source, target, key, changed)

    return arm


def lose(_link: Link, _parcel: Parcel, _amount: int) -> list[Parcel]:
    """Lose a message."""
    return []


def repeat(_link: Link, parcel: Parcel, _amount: int) -> list[Parcel]:
    """Carry a message twice."""
    return [parcel, parcel]


def delay(_link: Link, parcel: Parcel, amount: int) -> list[Parcel]:
    """Carry a message, and all after it, later [ns]."""
    return [parcel._replace(late_ns=parcel.late_ns + amount)]


def shorten(_link: Link, parcel: Parcel, _amount: int) -> list[Parcel]:
    """Carry a message without its last byte."""
    return [parcel._replace(data=parcel.data[:-1])]


def freeze_reader(link: Link, parcel: Parcel, _amount: int) -> list[Parcel]:
    """Stop the process that a message is for."""
    link.target.process.freeze()
    return [parcel]


def last_words(link: Link, parcel: Parcel, amount: int) -> list[Parcel]:
    """Kill a process after a message that it sends, which comes late."""
    process = link.source.process
    process.on_call[process.calls + 1] = process.kill
    process.world.after(1, process.kill)
    return delay(link, parcel, amount)


def field(name: str, change: Callable[[Any], Any]) -> Change:
    """Return what changes one field of an envelope."""

    def changed(_link: Link, parcel: Parcel, _amount: int) -> list[Parcel]:
        content = msgspec.msgpack.decode(parcel.data)
        content[name] = change(content.get(name))
        return [parcel._replace(data=msgspec.msgpack.encode(content))]

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


def wrong_hello(link: Link, parcel: Parcel, amount: int) -> list[Parcel]:
    """Change one field of a `Hello` to what the scenario does not have so."""
    name, value = HELLOS[amount]
    return field(name, lambda _old: value)(link, parcel, amount)


def other_type(ports: Any, _amount: int = 0) -> Any:
    """Return ports with content of another type."""
    return {port: {"position": "a word", "values": 7} for port in ports}


def wrong_newest(entries: list[Any] | None) -> list[Any]:
    """Return the outputs of a log, with content of another type in the newest."""
    *before, newest = entries or [None]
    return [] if newest is None else [*before, {**newest, "ports": other_type(newest["ports"])}]


def on_outputs(name: str, make: Callable[[Any, int], Any]) -> Arm:
    """Return what changes a field of the outputs that a participant publishes alone at a step."""

    def arm(execution: Execution, fault: Fault) -> None:
        step = fault.at - fault.at % execution.every(fault.target)

        def change(_link: Link, parcel: Parcel) -> list[Parcel]:
            try:
                outputs = msgspec.msgpack.decode(parcel.data, type=Outputs)
            except (msgspec.MsgspecError, ValueError):
                return [parcel]
            if outputs.step != step:
                return [parcel]
            execution.struck(fault)
            new = make(getattr(outputs, name), fault.amount)
            data = encode(msgspec.structs.replace(outputs, **{name: new}))
            return [parcel._replace(data=data)]

        execution.on_message(fault.target, "", "out", change)

    return arm


def late_bulk(execution: Execution, fault: Fault) -> None:
    """Let bulk content come late over a link, after all but other bulk content."""
    count, until_ns = 0, 0

    def change(_link: Link, parcel: Parcel) -> list[Parcel]:
        nonlocal count, until_ns
        now_ns = execution.world.now_ns
        if count == fault.at:
            execution.struck(fault)
            until_ns = now_ns + fault.amount
        count += 1
        if now_ns >= until_ns:
            return [parcel]
        return [parcel._replace(late_ns=until_ns - now_ns, is_overtaken=True)]

    source, _, target = fault.target.partition(">")
    execution.on_message(source, target, "bulk", change)


# --- links ----------------------------------------------------------------------------------


def late_link(execution: Execution, fault: Fault) -> None:
    """Let the connection of two processes, which carries both ways, come up late."""
    execution.network.late_ns[frozenset(fault.target.split(">"))] = fault.amount
    execution.struck(fault)


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


def at_call(act: Arm) -> Arm:
    """Return what strikes a process between two of its system calls."""

    def arm(execution: Execution, fault: Fault) -> None:
        execution.host.on_call[fault.target][fault.at] = lambda: execution.strike(fault, act)

    return arm


def in_step(act: Arm) -> Arm:
    """Return what happens to a participant in the midst of a step."""

    def arm(execution: Execution, fault: Fault) -> None:
        strike = partial(execution.strike, fault, act)
        execution.in_step[fault.target, fault.at].append(strike)

    return arm


def at_time(act: Arm, *, while_recorded: bool = False) -> Arm:
    """Return what strikes the machine at a time, or a run, where that still records."""

    def arm(execution: Execution, fault: Fault) -> None:
        def strike() -> None:
            is_over = execution.orchestrator.is_dead or execution.watch.is_recorded
            if not (while_recorded and is_over):
                execution.strike(fault, act)

        execution.world.after(fault.at, strike)

    return arm


def of_host(setting: str) -> Arm:
    """Return what changes a setting of the host for one process: its start, end or exit code."""

    def arm(execution: Execution, fault: Fault) -> None:
        getattr(execution.host, setting)[fault.target] = fault.amount
        execution.struck(fault)

    return arm


def kill(execution: Execution, fault: Fault) -> None:
    """End a process by a signal; a negative one is an exit code instead."""
    execution.process(fault.target).kill(-fault.amount)


def freeze(execution: Execution, fault: Fault) -> None:
    """Stop a process, for a time or for good: as long as there is an orchestrator to notice."""
    process = execution.process(fault.target)
    if execution.orchestrator.is_dead:
        return
    if fault.amount:
        execution.world.after(fault.amount, process.thaw)
    process.freeze()


def raise_error(_execution: Execution, _fault: Fault) -> None:
    """Raise an error."""
    raise ValueError("struck")


def compute_long(execution: Execution, fault: Fault) -> None:
    """Let a step take long."""
    execution.process(fault.target).clock.sleep(fault.amount / 1e9)


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
