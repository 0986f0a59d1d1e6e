"""How faults strike a simulated run: what is done to its links, processes, messages and disk."""

import os
import shutil
from collections.abc import Callable

from .execution import Execution
from .network import Link
from .tape import ORCHESTRATOR, Fault
from .world import Process

Arm = Callable[[Execution, Fault], None]

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
        if network.connect(one, other, is_up=False):
            execution.struck(fault)
            world.after(fault.amount, end)

    def end() -> None:
        network.connect(one, other, is_up=True)

    world.after(fault.at, begin)


def _both_ways(target: str) -> tuple[str, str]:
    one, other = target.split(">")
    return f"{one}>{other}", f"{other}>{one}"


# --- processes ------------------------------------------------------------------------------


def at_time(
    act: Callable[[Execution, Fault, Process], None],
) -> Arm:
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
) -> Arm:
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


def in_step(
    act: Callable[[Process, Fault], None],
) -> Arm:
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


def on_world(act: Arm, *, while_recorded: bool = False) -> Arm:
    """Return what strikes the machine at a time, or a run, where that still records."""

    def arm(execution: Execution, fault: Fault) -> None:
        def strike() -> None:
            is_over = execution.orchestrator.is_dead or execution.is_recorded
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


def raising(number: int, count: int | None) -> Arm:
    """Return what lets calls of the disk fail."""

    def strike(_number: int, _name: str, _size: int) -> int:
        raise OSError(number, os.strerror(number))

    def arm(execution: Execution, fault: Fault) -> None:
        _disk(execution, fault, strike, fault.amount if count is None else count)

    return arm


def short(execution: Execution, fault: Fault) -> None:
    """Let a write take only a part."""
    _disk(execution, fault, lambda _n, _name, size: min(size, max(1, fault.amount)), 1)


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
