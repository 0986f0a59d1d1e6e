"""What can go wrong in a simulated run: how each kind strikes, and what it may lead to."""

from __future__ import annotations

import errno
import os
import shutil
import signal
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from random import Random
from typing import TYPE_CHECKING, Any

import msgspec

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.run import LONGEST_TICK_S
from stepbus_schemas import Batch, Outputs, encode

from .network import Link
from .tape import Fault, Knobs
from .world import Process

if TYPE_CHECKING:
    from .execution import Execution

MS = 1_000_000
ORCHESTRATOR = "orchestrator"
_LATEST_NS = 400 * MS
"""Most strikes by the clock come in this time: a run of 50 steps takes some 150 ms."""
_PREFERENCE = 0.5
_START, _FAULT, _DIED = ExitCode.START, ExitCode.FAULT, ExitCode.DIED
_STEP, _STOP, _RECORDING = ExitCode.STEP_TIMEOUT, ExitCode.STOP_TIMEOUT, ExitCode.RECORDING
_LATE = frozenset({_START, _STEP, _STOP})
_LOST = frozenset({_START, _STEP, _STOP, _FAULT, _DIED})


@dataclass(frozen=True, kw_only=True)
class Draw:
    """What faults are drawn from: a generator, the names of the participants, the steps.

    preferred: a participant that is struck more often than others; faults of one meet. knobs: what
    lasts about as long as one of their deadlines is drawn more often.
    """

    random: Random
    names: list[str]
    steps: int
    preferred: str = ""
    knobs: Knobs = field(default_factory=Knobs)

    def name(self) -> str:
        """Return a participant: the preferred one, as often as any other."""
        if self.preferred and self.random.random() < _PREFERENCE:
            return self.preferred
        return self.random.choice(self.names)

    def process(self) -> str:
        """Return a process, the orchestrator among them."""
        return self.random.choice([*self.names, ORCHESTRATOR])

    def link(self) -> str:
        """Return a link from one process to another."""
        one = self.name()
        other = self.random.choice([name for name in [*self.names, ORCHESTRATOR] if name != one])
        return self.random.choice([f"{one}>{other}", f"{other}>{one}"])

    def link_to_participant(self) -> str:
        """Return a link to a participant; a log must come once (P8.6)."""
        one = self.name()
        other = self.random.choice([name for name in [*self.names, ORCHESTRATOR] if name != one])
        return f"{other}>{one}"

    def time(self) -> int:
        """Return a time at which something strikes [ns]."""
        return self.random.randrange(self.random.choice([1, 1, 5]) * _LATEST_NS)

    def lasting(self) -> int:
        """Return how long something lasts [ns]: a moment, about a deadline, or longer than most."""
        if self.random.random() < _PREFERENCE:
            return int(10 ** self.random.uniform(5, 10))
        phase = self.random.choice(["join", "ready", "step", "step", "step", "stop"])
        deadline_ns = MS * int(getattr(self.knobs, f"{phase}_ms"))
        return int(deadline_ns * self.random.uniform(0.8, 2.0))

    def call(self) -> int:
        """Return the number of a call of the machine: those of its start are few."""
        return int(10 ** self.random.uniform(0, 3))

    def few(self) -> int:
        """Return how many calls go wrong."""
        return self.random.randrange(1, 4)

    def step(self) -> int:
        """Return a step, or the closing one."""
        return self.random.choice([self.random.randrange(self.steps), self.steps - 1, self.steps])

    def message(self) -> int:
        """Return the number of a message of a link."""
        return self.random.randrange(2 * self.steps)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One kind of fault.

    what: a sentence. draw: one of it. arm: lets it strike. codes: exit codes that it may lead to,
    beside that of a run which it does not harm. lasts: whether `amount` is a time that deadlines
    are compared with. is_fatal: whether a run that it has struck cannot end well.
    """

    what: str
    draw: Callable[[Draw], Fault]
    arm: Callable[[Execution, Fault], None]
    codes: frozenset[ExitCode] = frozenset()
    lasts: bool = False
    is_fatal: bool = False

    def is_harmless(self, fault: Fault, knobs: Knobs, total_ns: int) -> bool:
        """Return whether a run has to end as if nothing had happened.

        total_ns: how long all faults of the run take together.
        """
        if not self.codes:
            return True
        return self.lasts and fault.amount > 0 and 2 * total_ns < knobs.shortest_ns


UNSEEN = ("never", "other_run", "other_step", "garbage", "bulk_never", "bulk_short")
"""What one publishes that nobody takes: its readers wait, and only they can be seen to."""


def lasting_ns(fault: Fault, knobs: Knobs) -> int:
    """Return how much of a deadline a fault may take [ns].

    The orchestrator counts little of the time that the machine sleeps; a participant that asks to
    join counts all of it.
    """
    if not KINDS[fault.kind].lasts:
        return 0
    if fault.kind == "sleep" and 4 * fault.amount < MS * knobs.join_ms:
        return min(fault.amount, int(LONGEST_TICK_S * 1e9))
    return fault.amount


def culprits(fault: Fault, names: Iterable[str], readers: Callable[[str], set[str]]) -> set[str]:
    """Return who may be blamed for a fault. names: of all. readers: of a participant."""
    if fault.kind in ("suspend", "sleep"):
        # Each participant goes by its own clock where it waits to be let in.
        return set(names)
    if fault.kind == "lost_call":
        return {"plant"}
    named = set(fault.target.split(">")) - {ORCHESTRATOR, ""}
    if fault.kind == "delay" and fault.target.startswith(ORCHESTRATOR):
        # Its puts block, and it cannot see at which reader.
        return set(names)
    # One that was stopped goes on, and those that wait for it are late already.
    goes_on = fault.kind in ("freeze", "hang") and fault.amount > 0
    return named | readers(fault.target) if fault.kind in UNSEEN or goes_on else named


# --- links ----------------------------------------------------------------------------------


def _on_message(what: str) -> Callable[[Execution, Fault], None]:
    def arm(execution: Execution, fault: Fault) -> None:
        def change(link: Link) -> None:
            link.changes[fault.at] = what, fault.amount
            link.struck[fault.at] = lambda: execution.struck(fault)

        execution.on_link(fault.target, change)

    return arm


def _late_link(execution: Execution, fault: Fault) -> None:
    """Let the connection of two processes, which carries both ways, come up late."""

    def delay(link: Link) -> None:
        network = execution.network
        key = frozenset(fault.target.split(">"))
        link.up_ns = network.up_ns.setdefault(key, execution.world.now_ns + fault.amount)
        execution.struck(fault)

    for name in _both_ways(fault.target):
        execution.on_link(name, delay)


def _cut(execution: Execution, fault: Fault) -> None:
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


def _at_time(
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


def _at_call(
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


def _kill(_execution: Execution, fault: Fault, process: Process) -> None:
    process.kill(-fault.amount)


def _freeze(execution: Execution, fault: Fault, process: Process) -> None:
    if fault.amount:
        execution.world.after(fault.amount, process.thaw)
    process.freeze()


def _slow_start(execution: Execution, fault: Fault) -> None:
    execution.host.start_ns[fault.target] = fault.amount
    execution.struck(fault)


def _linger(execution: Execution, fault: Fault) -> None:
    execution.host.linger_ns[fault.target] = fault.amount
    execution.struck(fault)


def _lie(execution: Execution, fault: Fault) -> None:
    execution.host.lies[fault.target] = fault.amount
    execution.struck(fault)


def _in_step(
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


def _ignore_triggers(execution: Execution, fault: Fault) -> None:
    def strike() -> None:
        execution.struck(fault)
        node = execution.network.nodes[fault.target]
        node.subscribers = [row for row in node.subscribers if row[0] != "trigger"]
        execution.network.changes += 1

    execution.in_step(fault.target, fault.at, strike)


def _raise(_process: Process, _fault: Fault) -> None:
    raise ValueError("struck")


def _exit(process: Process, fault: Fault) -> None:
    process.kill(fault.amount)


def _compute(process: Process, fault: Fault) -> None:
    process.clock.sleep(fault.amount / 1e9)


def _sleep(execution: Execution, fault: Fault) -> None:
    def strike() -> None:
        execution.struck(fault)
        execution.world.now_ns += fault.amount

    execution.world.after(fault.at, strike)


def _wall(execution: Execution, fault: Fault) -> None:
    def strike() -> None:
        execution.struck(fault)
        execution.world.wall_ns += fault.amount

    execution.world.after(fault.at, strike)


def _interrupt(execution: Execution, fault: Fault) -> None:
    def strike() -> None:
        if not execution.orchestrator.is_dead and not execution.is_recorded:
            execution.struck(fault)
            execution.interrupt.set()

    execution.world.after(fault.at, strike)


# --- what a participant publishes -----------------------------------------------------------


def _on_outputs(change: Callable[[bytes, int], list[bytes]]) -> Callable[[Execution, Fault], None]:
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


def _on_key(
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


def _field(name: str, change: Callable[[Any], Any]) -> Callable[[bytes, int], list[bytes]]:
    """Return what changes one field of an envelope."""

    def changed(data: bytes, _amount: int) -> list[bytes]:
        content = msgspec.msgpack.decode(data)
        content[name] = change(content.get(name))
        return [msgspec.msgpack.encode(content)]

    return changed


_HELLOS: tuple[tuple[str, Any], ...] = (
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


def _wrong_hello(data: bytes, amount: int) -> list[bytes]:
    """Return a `Hello` with one field that the scenario does not have so."""
    name, value = _HELLOS[amount]
    return _field(name, lambda _old: value)(data, amount)


def _other_type(_ports: Any) -> Any:
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


def _with(**fields: Callable[[Any, int], Any]) -> Callable[[bytes, int], list[bytes]]:
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


def _raising(number: int, count: int | None) -> Callable[[Execution, Fault], None]:
    def strike(_number: int, _name: str, _size: int) -> int:
        raise OSError(number, os.strerror(number))

    def arm(execution: Execution, fault: Fault) -> None:
        _disk(execution, fault, strike, fault.amount if count is None else count)

    return arm


def _short(execution: Execution, fault: Fault) -> None:
    _disk(execution, fault, lambda _n, _name, size: min(size, max(1, fault.amount)), 1)


def _folder(execution: Execution, fault: Fault) -> None:
    def strike() -> None:
        if not execution.orchestrator.is_dead and not execution.is_recorded:
            execution.struck(fault)
            shutil.rmtree(execution.out, ignore_errors=True)

    execution.world.after(fault.at, strike)


def _power(execution: Execution, fault: Fault) -> None:
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


_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV)

_DISK_CALLS = ("open", "pwrite", "ftruncate", "posix_fallocate", "fsync", "close", "replace")

CRASHES = frozenset({"crash", "crash_at_call", "power"})
"""Kinds that end the orchestrator."""

KINDS: dict[str, Kind] = {
    "delay": Kind(
        what="a message comes late, and all behind it",
        draw=lambda d: Fault("delay", d.link(), d.message(), d.lasting()),
        arm=_on_message("delay"), codes=_LATE, lasts=True,
    ),
    "drop": Kind(
        what="a message is lost",
        draw=lambda d: Fault("drop", d.link(), d.message()), arm=_on_message("drop"), codes=_LOST,
    ),
    "duplicate": Kind(
        what="a message to a participant comes twice",
        draw=lambda d: Fault("duplicate", d.link_to_participant(), d.message()),
        arm=_on_message("duplicate"),
    ),
    "log_twice": Kind(
        what="a message to the orchestrator comes twice",
        draw=lambda d: Fault("log_twice", f"{d.name()}>{ORCHESTRATOR}", d.message()),
        arm=_on_message("duplicate"), codes=frozenset({_FAULT}),
    ),
    "late_link": Kind(
        what="two processes are linked late; what is published before is lost",
        draw=lambda d: Fault("late_link", d.link(), 0, d.lasting()),
        arm=_late_link, codes=_LOST, lasts=True,
    ),
    "cut": Kind(
        what="the link of two processes breaks for a time, or all links of one, healed one by one",
        draw=lambda d: Fault("cut", d.link(), d.time(), d.lasting()), arm=_cut, codes=_LOST,
    ),
    "kill": Kind(
        what="a participant is killed",
        draw=lambda d: Fault("kill", d.name(), d.time(), d.random.choice(_SIGNALS)),
        arm=_at_time(_kill), codes=frozenset({_START, _DIED, _FAULT}), is_fatal=True,
    ),
    "freeze": Kind(
        what="a participant is stopped, for a time or for good",
        draw=lambda d: Fault("freeze", d.name(), d.time(), d.random.choice([0, d.lasting()])),
        arm=_at_time(_freeze), codes=_LATE, lasts=True,
    ),
    "suspend": Kind(
        what="the orchestrator is stopped for a time",
        draw=lambda d: Fault("suspend", ORCHESTRATOR, d.time(), d.lasting()),
        arm=_at_time(_freeze), codes=_LATE, lasts=True,
    ),
    "sleep": Kind(
        what="the machine sleeps",
        draw=lambda d: Fault("sleep", "", d.time(), d.lasting()),
        arm=_sleep, codes=_LATE, lasts=True,
    ),
    "wall": Kind(
        what="the time of day jumps",
        draw=lambda d: Fault("wall", "", d.time(), d.random.choice([-1, 1]) * d.lasting()),
        arm=_wall,
    ),
    "slow_start": Kind(
        what="a process takes long to start",
        draw=lambda d: Fault("slow_start", d.name(), 0, d.lasting()),
        arm=_slow_start, codes=frozenset({_START}), lasts=True,
    ),
    "lie": Kind(
        what="a participant ends with an exit code as if it had failed",
        draw=lambda d: Fault("lie", d.name(), 0, d.random.choice([1, 2, 77])),
        arm=_lie, codes=frozenset({_DIED, _START}), is_fatal=True,
    ),
    "raise": Kind(
        what="a participant raises",
        draw=lambda d: Fault("raise", d.name(), d.step()),
        arm=_in_step(_raise), codes=frozenset({_FAULT}), is_fatal=True,
    ),
    "exit": Kind(
        what="a participant exits within a step",
        draw=lambda d: Fault("exit", d.name(), d.step(), d.random.choice([0, 1, 77])),
        arm=_in_step(_exit), codes=frozenset({_DIED}), is_fatal=True,
    ),
    "compute": Kind(
        what="a participant takes long for a step",
        draw=lambda d: Fault("compute", d.name(), d.step(), d.lasting()),
        arm=_in_step(_compute), codes=_LATE, lasts=True,
    ),
    "slow_ready": Kind(
        what="a participant takes long to load",
        draw=lambda d: Fault("slow_ready", d.name(), -1, d.lasting()),
        arm=_in_step(_compute), codes=frozenset({_START}), lasts=True,
    ),
    "linger": Kind(
        what="a process takes long to end",
        draw=lambda d: Fault("linger", d.name(), 0, d.lasting()),
        arm=_linger, codes=frozenset({_STOP}), lasts=True,
    ),
    "wrong_message": Kind(
        what="outputs are not of their type",
        draw=lambda d: Fault("wrong_message", d.name(), d.step()),
        arm=_on_outputs(_with(ports=lambda ports, _amount: _other_type(ports))),
        codes=frozenset({_FAULT}),
    ),
    "wrong_log": Kind(
        what="a log is not of its type",
        draw=lambda d: Fault("wrong_log", d.name(), d.message()),
        arm=_on_key("log", _field("outputs", lambda rows: [*(rows or ()), {"step": "x"}])),
        codes=frozenset({_FAULT, _START}),
    ),
    "lost_log": Kind(
        what="a log is lost",
        draw=lambda d: Fault("lost_log", d.name(), d.message()),
        arm=_on_key("log", lambda _data, _amount: []), codes=_LOST,
    ),
    "wrong_hello": Kind(
        what="a participant asks to join with another protocol, token, name or ports",
        draw=lambda d: Fault("wrong_hello", d.name(), 0, d.random.randrange(len(_HELLOS))),
        arm=_on_key("join", _wrong_hello), codes=frozenset({_START}),
    ),
    "other_order": Kind(
        what="an order comes with the token of another run",
        draw=lambda d: Fault("other_order", ORCHESTRATOR, d.message()),
        arm=_on_key("trigger", _field("token", lambda token: token[::-1])),
    ),
    "bulk_short": Kind(
        what="bulk content is shorter than announced",
        draw=lambda d: Fault("bulk_short", "camera", d.message()),
        arm=_on_key("bulk", lambda data, _amount: [data[:-1]]), codes=frozenset({_FAULT}),
    ),
    "bulk_never": Kind(
        what="bulk content is lost",
        draw=lambda d: Fault("bulk_never", "camera", d.message()),
        arm=_on_key("bulk", lambda _data, _amount: []), codes=_LOST,
    ),
    "twice": Kind(
        what="outputs are published twice",
        draw=lambda d: Fault("twice", d.name(), d.step()),
        arm=_on_outputs(lambda data, _amount: [data, data]),
    ),
    "never": Kind(
        what="outputs are not published",
        draw=lambda d: Fault("never", d.name(), d.step()),
        arm=_on_outputs(lambda _data, _amount: []), codes=_LOST,
    ),
    "garbage": Kind(
        what="outputs are damaged",
        draw=lambda d: Fault("garbage", d.name(), d.step(), d.random.randrange(40)),
        arm=_on_outputs(lambda data, amount: [data[:amount] + b"\xc1" + data[amount + 1 :]]),
        codes=_LOST,
    ),
    "other_step": Kind(
        what="outputs are those of another step",
        draw=lambda d: Fault("other_step", d.name(), d.step(), d.random.choice([-1, 1, 4, 1000])),
        arm=_on_outputs(_with(step=lambda step, amount: step + amount)), codes=_LOST,
    ),
    "other_run": Kind(
        what="outputs have the token of another run",
        draw=lambda d: Fault("other_run", d.name(), d.step()),
        arm=_on_outputs(_with(token=lambda token, _amount: token[::-1])), codes=_LOST,
    ),
    "full": Kind(
        what="the disk is full from some write on",
        draw=lambda d: Fault("full", "pwrite", d.random.randrange(30), 1 << 40),
        arm=_raising(errno.ENOSPC, None), codes=frozenset({_RECORDING}),
    ),
    "full_once": Kind(
        what="the disk is full for a few writes",
        draw=lambda d: Fault("full_once", "pwrite", d.random.randrange(30), d.few()),
        arm=_raising(errno.ENOSPC, None), codes=frozenset({_RECORDING}),
    ),
    "disk_error": Kind(
        what="a call of the disk fails: open, write, cut, reserve, sync, close, rename",
        draw=lambda d: Fault(
            "disk_error",
            d.random.choice(_DISK_CALLS),
            d.random.randrange(20),
        ),
        arm=_raising(errno.EIO, 1), codes=frozenset({_RECORDING}),
    ),
    "short": Kind(
        what="the disk takes a part of a write",
        draw=lambda d: Fault("short", "pwrite", d.random.randrange(30), d.random.randrange(1, 100)),
        arm=_short,
    ),
    "folder": Kind(
        what="the folder of the run is removed",
        draw=lambda d: Fault("folder", "", d.time()), arm=_folder,
        codes=frozenset({_RECORDING}), is_fatal=True,
    ),
    "interrupt": Kind(
        what="the user interrupts the run",
        draw=lambda d: Fault("interrupt", "", d.time()), arm=_interrupt,
        codes=frozenset({ExitCode.INTERRUPTED}),
    ),
    "die": Kind(
        what="a participant is killed between two of its calls of the machine",
        draw=lambda d: Fault("die", d.name(), d.call(), d.random.choice(_SIGNALS)),
        arm=_at_call(_kill), codes=frozenset({_START, _DIED, _FAULT}), is_fatal=True,
    ),
    "hang": Kind(
        what="a participant is stopped between two of its calls of the machine",
        draw=lambda d: Fault("hang", d.name(), d.call(), d.random.choice([0, d.lasting()])),
        arm=_at_call(_freeze), codes=_LATE, lasts=True,
    ),
    "no_triggers": Kind(
        what="a participant reads no triggers from some step on",
        draw=lambda d: Fault("no_triggers", d.name(), d.step()),
        arm=_ignore_triggers, codes=_LATE,
    ),
    "lost_call": Kind(
        what="a call of a user is lost on its way to the participant",
        draw=lambda d: Fault("lost_call", ORCHESTRATOR, d.few()),
        arm=_on_key("call", lambda _data, _amount: []), codes=frozenset({_STEP}),
    ),
    "lost_answer": Kind(
        what="the answer to a call is lost",
        draw=lambda d: Fault("lost_answer", "plant", d.few()),
        arm=_on_key("called", lambda _data, _amount: []), codes=frozenset({_STEP}),
    ),
    "answer_twice": Kind(
        what="the answer to a call comes twice",
        draw=lambda d: Fault("answer_twice", "plant", d.few()),
        arm=_on_key("called", lambda data, _amount: [data, data]),
    ),
    "power": Kind(
        what="the power fails: the last write is torn, or the last rename is lost",
        draw=lambda d: Fault(
            "power", d.random.choice(["pwrite", "pwrite", "replace"]), d.random.randrange(20),
            d.random.randrange(1000),
        ),
        arm=_power,
    ),
    "crash_at_call": Kind(
        what="the orchestrator is killed between two of its calls of the machine",
        draw=lambda d: Fault("crash_at_call", ORCHESTRATOR, 2 * d.call(), signal.SIGKILL),
        arm=_at_call(_kill),
    ),
    "crash": Kind(
        what="the orchestrator is killed",
        draw=lambda d: Fault("crash", ORCHESTRATOR, d.time(), signal.SIGKILL), arm=_at_time(_kill),
    ),
}  # fmt: skip
"""Name of a kind → what it is."""
