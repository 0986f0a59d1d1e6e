"""The kinds of faults of a simulated run: how each is drawn and strikes, what it may lead to.

The first rows are those of `--fault`, which strike real processes too; the others need a bus, a
clock, a disk or processes that are simulated.
"""

import errno
import signal
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.run import LONGEST_TICK_S

from . import strikes
from .draw import Draw
from .execution import Execution
from .strikes import Arm, at_call, at_time, by_run, in_step, of_host, on_message, on_outputs
from .tape import MS, ORCHESTRATOR, Fault, Knobs

Drawn = tuple[str, int] | tuple[str, int, int]
"""Target, `at` and amount of a fault."""

_START, _FAULT, _DIED = ExitCode.START, ExitCode.FAULT, ExitCode.DIED
_STEP, _STOP, _RECORDING = ExitCode.STEP_TIMEOUT, ExitCode.STOP_TIMEOUT, ExitCode.RECORDING
_LATE = frozenset({_START, _STEP, _STOP})
_LOST = frozenset({_START, _STEP, _STOP, _FAULT, _DIED})
_DEAD = frozenset({_START, _DIED, _FAULT})
_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV)
_DISK_CALLS = ("open", "pwrite", "ftruncate", "posix_fallocate", "fsync", "close", "replace")


@dataclass(frozen=True)
class Kind:
    """One kind of fault.

    what: a sentence. draw: one of it. arm: lets it strike. codes: exit codes that it may lead to,
    beside that of a run which it does not harm. lasts: whether `amount` is a time that deadlines
    are compared with. is_fatal: whether a run that it has struck cannot end well. needs: the
    scenario in which it strikes; empty: any.
    """

    what: str
    draw: Callable[[Draw], Drawn]
    arm: Arm
    codes: frozenset[ExitCode] = frozenset()
    lasts: bool = False
    is_fatal: bool = False
    needs: str = ""

    def is_harmless(self, fault: Fault, knobs: Knobs, total_ns: int) -> bool:
        """Return whether a run has to end as if nothing had happened.

        total_ns: how long all faults of the run take together.
        """
        if not self.codes:
            return True
        return self.lasts and fault.amount > 0 and 2 * total_ns < knobs.shortest_ns


INJECTED: dict[str, Kind] = {
    "drop": Kind("outputs are not published", Draw.of_step, by_run, _LOST),
    "delay": Kind("outputs are published late", Draw.of_slow_step, by_run, _LATE, lasts=True),
    "duplicate": Kind("outputs are published twice", Draw.of_step, by_run),
    "reorder": Kind("outputs are published after the next ones", Draw.of_step, by_run, _LOST),
    "corrupt": Kind("outputs are damaged", Draw.of_step, by_run, _LOST),
    "oversize": Kind("outputs have a megabyte that nobody reads", Draw.of_step, by_run),
    "freeze": Kind(
        "a participant is stopped, for a time or permanently",
        lambda d: (*d.of_step(), d.random.choice([0, d.lasting()])), by_run, _LATE, lasts=True,
    ),
    "slow": Kind("a participant is slowed down", Draw.of_slow_step, by_run, _LATE, lasts=True),
    "kill": Kind("a participant is killed", Draw.of_step, by_run, _DEAD, is_fatal=True),
    "crash": Kind("a participant crashes", Draw.of_step, by_run, _DEAD, is_fatal=True),
}  # fmt: skip
"""Type of `--fault` → its kind."""

SIMULATED: dict[str, Kind] = {
    "link_delay": Kind(
        "a message comes late, and so do all after it",
        lambda d: (d.link(), d.message(), d.lasting()),
        on_message("", strikes.delay), _LATE | {_DIED}, lasts=True,
    ),
    "link_drop": Kind(
        "a message is lost",
        lambda d: (d.link(), d.message()), on_message("", strikes.lose), _LOST,
    ),
    "link_twice": Kind(
        "a message to a participant comes twice",
        lambda d: (d.link_to_participant(), d.message()), on_message("", strikes.repeat),
    ),
    "log_twice": Kind(
        "a message to the orchestrator comes twice",
        lambda d: (f"{d.name()}>{ORCHESTRATOR}", d.message()),
        on_message("", strikes.repeat), frozenset({_FAULT}),
    ),
    "late_link": Kind(
        "the link of two processes comes up late; messages published before are lost",
        lambda d: (d.link(), 0, d.lasting()), strikes.late_link, _LOST, lasts=True,
    ),
    "cut": Kind(
        "a link breaks for a time, or all links of a process, restored one by one",
        lambda d: (d.link(), d.time(), d.lasting()), strikes.cut, _LOST,
    ),
    "suspend": Kind(
        "the orchestrator is stopped for a time",
        lambda d: (ORCHESTRATOR, 2 * d.call(), d.lasting()),
        at_call(strikes.freeze), _LATE, lasts=True,
    ),
    "sleep": Kind(
        "the machine sleeps",
        lambda d: ("", d.time(), d.lasting()), at_time(strikes.sleep), _LATE, lasts=True,
    ),
    "wall": Kind(
        "the time of day jumps",
        lambda d: ("", d.time(), d.random.choice([-1, 1]) * d.lasting()), at_time(strikes.wall),
    ),
    "slow_start": Kind(
        "a process is slow to start",
        lambda d: (d.name(), 0, d.lasting()), of_host("start_ns"), frozenset({_START}), lasts=True,
    ),
    "slow_ready": Kind(
        "a participant is slow to load",
        lambda d: (d.name(), -1, d.lasting()),
        in_step(strikes.compute_long), frozenset({_START}), lasts=True,
    ),
    "compute": Kind(
        "a participant is slow to compute a step",
        Draw.of_slow_step, in_step(strikes.compute_long), _LATE, lasts=True,
    ),
    "linger": Kind(
        "a process is slow to end",
        lambda d: (d.name(), 0, d.lasting()), of_host("linger_ns"), frozenset({_STOP}), lasts=True,
    ),
    "lie": Kind(
        "a participant ends with an exit code as if it had failed",
        lambda d: (d.name(), 0, d.random.choice([1, 2, 77])),
        of_host("lies"), frozenset({_DIED, _START}), is_fatal=True,
    ),
    "raise": Kind(
        "a participant raises",
        Draw.of_step, in_step(strikes.raise_error), frozenset({_FAULT}), is_fatal=True,
    ),
    "exit": Kind(
        "a participant exits within a step",
        lambda d: (*d.of_step(), d.random.choice([0, -1, -77])),
        in_step(strikes.kill), frozenset({_DIED}), is_fatal=True,
    ),
    "wrong_message": Kind(
        "outputs are not of their type",
        Draw.of_step, on_outputs("ports", strikes.other_type), frozenset({_FAULT}),
    ),
    "other_step": Kind(
        "outputs are those of another step",
        lambda d: (*d.of_step(), d.random.choice([-1, 1, 4, 1000])),
        on_outputs("step", lambda step, amount: step + amount), _LOST,
    ),
    "other_run": Kind(
        "outputs have the token of another run",
        Draw.of_step, on_outputs("token", lambda token, _amount: token[::-1]), _LOST,
    ),
    "wrong_log": Kind(
        "a log is not of its type",
        lambda d: (d.name(), d.message()),
        on_message("log", strikes.field("outputs", lambda rows: [*(rows or ()), {"step": "x"}])),
        frozenset({_FAULT, _START}),
    ),
    "wrong_entry": Kind(
        "a log has outputs that are not of their type",
        lambda d: (d.name(), d.message()),
        on_message("log", strikes.field("outputs", strikes.wrong_newest)), frozenset({_FAULT}),
    ),
    "wrong_hello": Kind(
        "a participant asks to join with another protocol, token, name or ports",
        lambda d: (d.name(), 0, d.random.randrange(len(strikes.HELLOS))),
        on_message("join", strikes.wrong_hello), frozenset({_START}),
    ),
    "other_order": Kind(
        "a trigger comes with the token of another run",
        lambda d: (ORCHESTRATOR, d.message()),
        on_message("trigger", strikes.field("token", lambda token: token[::-1])),
    ),
    "bulk_short": Kind(
        "bulk content is shorter than announced",
        lambda d: ("camera", d.message()),
        on_message("bulk", strikes.shorten), frozenset({_FAULT}), needs="seen",
    ),
    "bulk_late": Kind(
        "bulk content comes late: everything except other bulk content overtakes it",
        lambda d: (d.bulk_link(), d.message(), d.lasting()),
        strikes.late_bulk, _LATE, lasts=True, needs="seen",
    ),
    "bulk_never": Kind(
        "bulk content is lost",
        lambda d: (d.bulk_link(), d.message()), on_message("bulk", strikes.lose), _LOST,
        needs="seen",
    ),
    "full": Kind(
        "the disk is full from some write on, or for a few writes",
        lambda d: ("pwrite", d.random.randrange(30), d.random.choice([d.few(), 1 << 40])),
        strikes.raising(errno.ENOSPC), frozenset({_RECORDING}),
    ),
    "disk_error": Kind(
        "a disk operation fails: open, write, truncate, reserve, sync, close, rename",
        lambda d: (d.random.choice(_DISK_CALLS), d.random.randrange(20)),
        strikes.raising(errno.EIO), frozenset({_RECORDING}),
    ),
    "short": Kind(
        "the disk accepts only part of a write",
        lambda d: ("pwrite", d.random.randrange(30), d.random.randrange(1, 100)), strikes.short,
    ),
    "folder": Kind(
        "the folder of the run is removed",
        lambda d: ("", d.time()), at_time(strikes.remove_folder, while_recorded=True),
        frozenset({_RECORDING}), is_fatal=True,
    ),
    "interrupt": Kind(
        "the user interrupts the run",
        lambda d: ("", d.time()), at_time(strikes.interrupt, while_recorded=True),
        frozenset({ExitCode.INTERRUPTED}),
    ),
    "die": Kind(
        "a participant is killed between two of its system calls",
        lambda d: (d.name(), d.call(), d.random.choice(_SIGNALS)),
        at_call(strikes.kill), _DEAD, is_fatal=True,
    ),
    "hang": Kind(
        "a participant is stopped between two of its system calls",
        lambda d: (d.name(), d.call(), d.random.choice([0, d.lasting()])),
        at_call(strikes.freeze), _LATE, lasts=True,
    ),
    "last_words": Kind(
        "a participant is killed, and the log that it has just sent comes late",
        lambda d: (d.name(), d.message(), d.random.randrange(MS, 600 * MS)),
        on_message("log", strikes.last_words), _DEAD, needs="held",
    ),
    "deaf": Kind(
        "a participant is stopped once it is asked to end",
        lambda d: (f"{ORCHESTRATOR}>{d.name()}", 0),
        on_message("stop", strikes.freeze_reader), frozenset({_STEP, _STOP}),
    ),
    "no_triggers": Kind(
        "a participant reads no triggers from some step on",
        lambda d: (f"{ORCHESTRATOR}>{d.name()}", d.message()),
        on_message("trigger", strikes.lose, more=True), _LATE,
    ),
    "lost_call": Kind(
        "a user's call is lost on its way to the participant",
        lambda d: (ORCHESTRATOR, d.few()), on_message("call", strikes.lose), frozenset({_STEP}),
        needs="called",
    ),
    "lost_answer": Kind(
        "the answer to a call is lost",
        lambda d: ("plant", d.few()), on_message("called", strikes.lose), frozenset({_STEP}),
        needs="called",
    ),
    "power": Kind(
        "the power fails: the last write is torn, or the last rename is lost",
        lambda d: (
            d.random.choice(["pwrite", "pwrite", "replace"]), d.random.randrange(20),
            d.random.randrange(1000),
        ),
        strikes.power,
    ),
    "orchestrator_dies": Kind(
        "the orchestrator is killed between two of its system calls",
        lambda d: (ORCHESTRATOR, 2 * d.call(), signal.SIGKILL), at_call(strikes.kill),
    ),
}  # fmt: skip
"""Name of a kind that only a simulation has → what it is."""

KINDS = INJECTED | SIMULATED

CRASHES = frozenset({"orchestrator_dies", "power"})
"""Kinds that end the orchestrator."""

UNSEEN = ("drop", "reorder", "corrupt", "other_run", "other_step", "bulk_short")
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
    if fault.kind == "link_delay" and fault.target.startswith(ORCHESTRATOR):
        # Its puts block, and it cannot see at which reader.
        return set(names)
    named = set(fault.target.split(">")) - {ORCHESTRATOR, ""}
    # One that was stopped goes on, and those that wait for it are late already.
    goes_on = fault.kind in ("freeze", "slow", "hang") and fault.amount > 0
    return named | readers(fault.target) if fault.kind in UNSEEN or goes_on else named


def arm(execution: Execution) -> None:
    """Let the faults of its tape strike a run, which may then take so much longer."""
    faults, healing_ns = execution.tape.faults, MS * execution.tape.knobs.heal_ms
    for fault in faults:
        KINDS[fault.kind].arm(execution, fault)
    cut_ns = sum(fault.amount for fault in faults if fault.kind == "cut")
    lasting_ns = sum(fault.amount for fault in faults if KINDS[fault.kind].lasts)
    execution.lasting_ns = lasting_ns + (min(cut_ns, healing_ns) if healing_ns else cut_ns)
