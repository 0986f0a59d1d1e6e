"""The kinds of faults of a simulated run: how each is drawn and strikes, what it may lead to."""

import errno
import signal
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.run import LONGEST_TICK_S

from .draw import Draw
from .execution import Execution
from .forged import (
    HELLOS,
    field,
    last_words,
    late_bulk,
    on_key,
    on_outputs,
    other_type,
    with_fields,
    wrong_hello,
    wrong_newest,
)
from .strikes import (
    Arm,
    at_call,
    at_time,
    compute_long,
    cut,
    deaf,
    end_process,
    freeze,
    ignore_triggers,
    in_step,
    interrupt,
    kill,
    late_link,
    of_host,
    on_message,
    on_world,
    power,
    raise_error,
    raising,
    remove_folder,
    short,
    sleep,
    wall,
)
from .tape import MS, ORCHESTRATOR, Fault, Knobs

_START, _FAULT, _DIED = ExitCode.START, ExitCode.FAULT, ExitCode.DIED
_STEP, _STOP, _RECORDING = ExitCode.STEP_TIMEOUT, ExitCode.STOP_TIMEOUT, ExitCode.RECORDING
_LATE = frozenset({_START, _STEP, _STOP})
_LOST = frozenset({_START, _STEP, _STOP, _FAULT, _DIED})


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One kind of fault.

    what: a sentence. draw: one of it. arm: lets it strike. codes: exit codes that it may lead to,
    beside that of a run which it does not harm. lasts: whether `amount` is a time that deadlines
    are compared with. is_fatal: whether a run that it has struck cannot end well. needs: the
    scenario in which it strikes; empty: any. real: the `--fault` that does the same to real
    processes, or the command of a shell; empty: none does.
    """

    what: str
    draw: Callable[[Draw], Fault]
    arm: Arm
    codes: frozenset[ExitCode] = frozenset()
    lasts: bool = False
    is_fatal: bool = False
    needs: str = ""
    real: str = ""

    def is_harmless(self, fault: Fault, knobs: Knobs, total_ns: int) -> bool:
        """Return whether a run has to end as if nothing had happened.

        total_ns: how long all faults of the run take together.
        """
        if not self.codes:
            return True
        return self.lasts and fault.amount > 0 and 2 * total_ns < knobs.shortest_ns


UNSEEN = ("never", "other_run", "other_step", "garbage", "bulk_short")
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


_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV)

_DISK_CALLS = ("open", "pwrite", "ftruncate", "posix_fallocate", "fsync", "close", "replace")

CRASHES = frozenset({"crash", "crash_at_call", "power"})
"""Kinds that end the orchestrator."""

KINDS: dict[str, Kind] = {
    "delay": Kind(
        what="a message comes late, and so do all behind it",
        draw=lambda d: Fault("delay", d.link(), d.message(), d.lasting()),
        arm=on_message("delay"), codes=_LATE | {_DIED}, lasts=True,
    ),
    "drop": Kind(
        what="a message is lost",
        draw=lambda d: Fault("drop", d.link(), d.message()), arm=on_message("drop"), codes=_LOST,
    ),
    "duplicate": Kind(
        what="a message to a participant comes twice",
        draw=lambda d: Fault("duplicate", d.link_to_participant(), d.message()),
        arm=on_message("duplicate"),
    ),
    "log_twice": Kind(
        what="a message to the orchestrator comes twice",
        draw=lambda d: Fault("log_twice", f"{d.name()}>{ORCHESTRATOR}", d.message()),
        arm=on_message("duplicate"), codes=frozenset({_FAULT}),
    ),
    "late_link": Kind(
        what="the link of two processes comes up late; messages published before are lost",
        draw=lambda d: Fault("late_link", d.link(), 0, d.lasting()),
        arm=late_link, codes=_LOST, lasts=True,
    ),
    "cut": Kind(
        what="a link breaks for a time, or all links of a process, restored one by one",
        draw=lambda d: Fault("cut", d.link(), d.time(), d.lasting()), arm=cut, codes=_LOST,
    ),
    "kill": Kind(
        what="a participant is killed",
        draw=lambda d: Fault("kill", d.name(), d.time(), d.random.choice(_SIGNALS)),
        arm=at_time(kill), codes=frozenset({_START, _DIED, _FAULT}), is_fatal=True,
        real="--fault 'kill {target} at {struck}'",
    ),
    "freeze": Kind(
        what="a participant is stopped, for a time or permanently",
        draw=lambda d: Fault("freeze", d.name(), d.time(), d.random.choice([0, d.lasting()])),
        arm=at_time(freeze), codes=_LATE, lasts=True,
        real="--fault 'freeze {target} at {struck}{lasting}'",
    ),
    "suspend": Kind(
        what="the orchestrator is stopped for a time",
        draw=lambda d: Fault("suspend", ORCHESTRATOR, d.time(), d.lasting()),
        arm=at_time(freeze), codes=_LATE, lasts=True,
        real="kill -STOP ORCHESTRATOR; sleep {s}; kill -CONT ORCHESTRATOR",
    ),
    "sleep": Kind(
        what="the machine sleeps",
        draw=lambda d: Fault("sleep", "", d.time(), d.lasting()),
        arm=on_world(sleep), codes=_LATE, lasts=True,
    ),
    "wall": Kind(
        what="the time of day jumps",
        draw=lambda d: Fault("wall", "", d.time(), d.random.choice([-1, 1]) * d.lasting()),
        arm=on_world(wall),
    ),
    "slow_start": Kind(
        what="a process is slow to start",
        draw=lambda d: Fault("slow_start", d.name(), 0, d.lasting()),
        arm=of_host("start_ns"), codes=frozenset({_START}), lasts=True,
    ),
    "lie": Kind(
        what="a participant ends with an exit code as if it had failed",
        draw=lambda d: Fault("lie", d.name(), 0, d.random.choice([1, 2, 77])),
        arm=of_host("lies"), codes=frozenset({_DIED, _START}), is_fatal=True,
    ),
    "raise": Kind(
        what="a participant raises",
        draw=lambda d: Fault("raise", d.name(), d.step()),
        arm=in_step(raise_error), codes=frozenset({_FAULT}), is_fatal=True,
    ),
    "exit": Kind(
        what="a participant exits within a step",
        draw=lambda d: Fault("exit", d.name(), d.step(), d.random.choice([0, 1, 77])),
        arm=in_step(end_process), codes=frozenset({_DIED}), is_fatal=True,
    ),
    "compute": Kind(
        what="a participant is slow to compute a step",
        draw=lambda d: Fault("compute", d.name(), d.step(), d.lasting()),
        arm=in_step(compute_long), codes=_LATE, lasts=True,
    ),
    "slow_ready": Kind(
        what="a participant is slow to load",
        draw=lambda d: Fault("slow_ready", d.name(), -1, d.lasting()),
        arm=in_step(compute_long), codes=frozenset({_START}), lasts=True,
    ),
    "linger": Kind(
        what="a process is slow to end",
        draw=lambda d: Fault("linger", d.name(), 0, d.lasting()),
        arm=of_host("linger_ns"), codes=frozenset({_STOP}), lasts=True,
    ),
    "wrong_message": Kind(
        what="outputs are not of their type",
        draw=lambda d: Fault("wrong_message", d.name(), d.step()),
        arm=on_outputs(with_fields(ports=lambda ports, _amount: other_type(ports))),
        codes=frozenset({_FAULT}),
    ),
    "wrong_log": Kind(
        what="a log is not of its type",
        draw=lambda d: Fault("wrong_log", d.name(), d.message()),
        arm=on_key("log", field("outputs", lambda rows: [*(rows or ()), {"step": "x"}])),
        codes=frozenset({_FAULT, _START}),
    ),
    "wrong_entry": Kind(
        what="a log has outputs that are not of their type",
        draw=lambda d: Fault("wrong_entry", d.name(), d.message()),
        arm=on_key("log", field("outputs", wrong_newest)), codes=frozenset({_FAULT}),
    ),
    "lost_log": Kind(
        what="a log is lost",
        draw=lambda d: Fault("lost_log", d.name(), d.message()),
        arm=on_key("log", lambda _data, _amount: []), codes=_LOST,
    ),
    "wrong_hello": Kind(
        what="a participant asks to join with another protocol, token, name or ports",
        draw=lambda d: Fault("wrong_hello", d.name(), 0, d.random.randrange(len(HELLOS))),
        arm=on_key("join", wrong_hello), codes=frozenset({_START}),
    ),
    "other_order": Kind(
        what="a trigger comes with the token of another run",
        draw=lambda d: Fault("other_order", ORCHESTRATOR, d.message()),
        arm=on_key("trigger", field("token", lambda token: token[::-1])),
    ),
    "bulk_short": Kind(
        what="bulk content is shorter than announced",
        draw=lambda d: Fault("bulk_short", "camera", d.message()),
        arm=on_key("bulk", lambda data, _amount: [data[:-1]]), codes=frozenset({_FAULT}),
        needs="seen",
    ),
    "bulk_late": Kind(
        what="bulk content comes late: everything except other bulk content overtakes it",
        draw=lambda d: Fault("bulk_late", d.bulk_link(), d.message(), d.lasting()),
        arm=late_bulk, codes=_LATE, lasts=True, needs="seen",
    ),
    "bulk_never": Kind(
        what="bulk content is lost",
        draw=lambda d: Fault("bulk_never", d.bulk_link(), d.message()), arm=late_bulk,
        codes=_LOST, needs="seen",
    ),
    "twice": Kind(
        what="outputs are published twice",
        draw=lambda d: Fault("twice", d.name(), d.step()),
        arm=on_outputs(lambda data, _amount: [data, data]),
        real="--fault 'duplicate {target} at {step}'",
    ),
    "never": Kind(
        what="outputs are not published",
        draw=lambda d: Fault("never", d.name(), d.step()),
        arm=on_outputs(lambda _data, _amount: []), codes=_LOST,
        real="--fault 'drop {target} at {step}'",
    ),
    "garbage": Kind(
        what="outputs are damaged",
        draw=lambda d: Fault("garbage", d.name(), d.step(), d.random.randrange(40)),
        arm=on_outputs(lambda data, amount: [data[:amount] + b"\xc1" + data[amount + 1 :]]),
        codes=_LOST,
        real="--fault 'corrupt {target} at {step}'",
    ),
    "other_step": Kind(
        what="outputs are those of another step",
        draw=lambda d: Fault("other_step", d.name(), d.step(), d.random.choice([-1, 1, 4, 1000])),
        arm=on_outputs(with_fields(step=lambda step, amount: step + amount)), codes=_LOST,
    ),
    "other_run": Kind(
        what="outputs have the token of another run",
        draw=lambda d: Fault("other_run", d.name(), d.step()),
        arm=on_outputs(with_fields(token=lambda token, _amount: token[::-1])), codes=_LOST,
    ),
    "full": Kind(
        what="the disk is full from some write on",
        draw=lambda d: Fault("full", "pwrite", d.random.randrange(30), 1 << 40),
        arm=raising(errno.ENOSPC, None), codes=frozenset({_RECORDING}),
        real="stepbus run … --out on a disk that becomes full: mount -t tmpfs -o size=1m none DIR",
    ),
    "full_once": Kind(
        what="the disk is full for a few writes",
        draw=lambda d: Fault("full_once", "pwrite", d.random.randrange(30), d.few()),
        arm=raising(errno.ENOSPC, None), codes=frozenset({_RECORDING}),
        real="fill the disk of --out for a moment: fallocate -l SIZE DIR/x; rm DIR/x",
    ),
    "disk_error": Kind(
        what="a disk operation fails: open, write, truncate, reserve, sync, close, rename",
        draw=lambda d: Fault(
            "disk_error",
            d.random.choice(_DISK_CALLS),
            d.random.randrange(20),
        ),
        arm=raising(errno.EIO, 1), codes=frozenset({_RECORDING}),
    ),
    "short": Kind(
        what="the disk accepts only part of a write",
        draw=lambda d: Fault("short", "pwrite", d.random.randrange(30), d.random.randrange(1, 100)),
        arm=short,
    ),
    "folder": Kind(
        what="the folder of the run is removed",
        draw=lambda d: Fault("folder", "", d.time()),
        arm=on_world(remove_folder, while_recorded=True),
        codes=frozenset({_RECORDING}), is_fatal=True,
        real="rm -r RUN  # while it runs",
    ),
    "interrupt": Kind(
        what="the user interrupts the run",
        draw=lambda d: Fault("interrupt", "", d.time()),
        arm=on_world(interrupt, while_recorded=True),
        codes=frozenset({ExitCode.INTERRUPTED}),
        real="kill -INT ORCHESTRATOR",
    ),
    "die": Kind(
        what="a participant is killed between two of its system calls",
        draw=lambda d: Fault("die", d.name(), d.call(), d.random.choice(_SIGNALS)),
        arm=at_call(kill), codes=frozenset({_START, _DIED, _FAULT}), is_fatal=True,
    ),
    "hang": Kind(
        what="a participant is stopped between two of its system calls",
        draw=lambda d: Fault("hang", d.name(), d.call(), d.random.choice([0, d.lasting()])),
        arm=at_call(freeze), codes=_LATE, lasts=True,
    ),
    "last_words": Kind(
        what="a participant is killed, and the log that it has just sent comes late",
        draw=lambda d: Fault("last_words", d.name(), d.message(), d.random.randrange(MS, 600 * MS)),
        arm=last_words, codes=frozenset({_START, _DIED, _FAULT}), needs="held",
    ),
    "deaf": Kind(
        what="a participant is stopped once it is asked to end",
        draw=lambda d: Fault("deaf", d.name()), arm=deaf, codes=frozenset({_STEP, _STOP}),
    ),
    "no_triggers": Kind(
        what="a participant reads no triggers from some step on",
        draw=lambda d: Fault("no_triggers", d.name(), d.step()),
        arm=ignore_triggers, codes=_LATE,
    ),
    "lost_call": Kind(
        what="a user's call is lost on its way to the participant",
        draw=lambda d: Fault("lost_call", ORCHESTRATOR, d.few()),
        arm=on_key("call", lambda _data, _amount: []), codes=frozenset({_STEP}), needs="called",
    ),
    "lost_answer": Kind(
        what="the answer to a call is lost",
        draw=lambda d: Fault("lost_answer", "plant", d.few()),
        arm=on_key("called", lambda _data, _amount: []), codes=frozenset({_STEP}), needs="called",
    ),
    "answer_twice": Kind(
        what="the answer to a call comes twice",
        draw=lambda d: Fault("answer_twice", "plant", d.few()),
        arm=on_key("called", lambda data, _amount: [data, data]), needs="called",
    ),
    "power": Kind(
        what="the power fails: the last write is torn, or the last rename is lost",
        draw=lambda d: Fault(
            "power", d.random.choice(["pwrite", "pwrite", "replace"]), d.random.randrange(20),
            d.random.randrange(1000),
        ),
        arm=power,
    ),
    "crash_at_call": Kind(
        what="the orchestrator is killed between two of its system calls",
        draw=lambda d: Fault("crash_at_call", ORCHESTRATOR, 2 * d.call(), signal.SIGKILL),
        arm=at_call(kill),
    ),
    "crash": Kind(
        what="the orchestrator is killed",
        draw=lambda d: Fault("crash", ORCHESTRATOR, d.time(), signal.SIGKILL), arm=at_time(kill),
        real="kill -KILL ORCHESTRATOR",
    ),
}  # fmt: skip
"""Name of a kind → what it is."""


def arm(execution: Execution) -> None:
    """Let the faults of its tape strike a run, which may then take so much longer."""
    faults, healing_ns = execution.tape.faults, MS * execution.tape.knobs.heal_ms
    for fault in faults:
        KINDS[fault.kind].arm(execution, fault)
    cut_ns = sum(fault.amount for fault in faults if fault.kind == "cut")
    lasting_ns = sum(fault.amount for fault in faults if KINDS[fault.kind].lasts)
    execution.lasting_ns = lasting_ns + (min(cut_ns, healing_ns) if healing_ns else cut_ns)
