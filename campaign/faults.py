"""Every type of fault from outside: a row says what strikes when, and what may come of it.

What `--fault` or the simulator has is not here, but for what needs a real kernel; a test has each
stream that is full, closed or not read (tests/orchestrator/cli/test_endings.py).
"""

from __future__ import annotations

import contextlib
import random
import resource
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import psutil

from . import disks
from .sandbox import START_S, Missed, Sandbox, Strike

_PROGRAM = Path(__file__).with_name("stranger.py")
_READY_S = 30.0

START, MIDDLE, END, EARLY = ("start",), ("middle",), ("end",), ("start", "middle")
TCP = ("--set", "bus.transport=tcp")
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
DONE, STOPPED, KILLED = frozenset({0}), frozenset({130}), frozenset({-signal.SIGKILL})
DEAD, REFUSED = frozenset({3, 5}), frozenset({8})
ANY_END = frozenset({0, 3, 4, 5, 6, 7, 8, 9, 130})
LIMITED = ANY_END - {130} | {1}
"""A process may meet a limit anywhere."""
KEPT = DONE | REFUSED
"""A file may be hit where nothing has been written for good; then the recording must be whole."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One type of fault.

    strike: does it, given the sandbox and a source of chance; None where what was prepared is the
    fault. codes: exit codes the run may end with; a negative one is a signal. blames: whom a run
    that failed must name: the participant that was `hit`, `nobody`, or `any`. when: the moments at
    which it may strike. endless: the run ends only by the fault; otherwise it must end by itself,
    and where its code is 0, with the recording of an undisturbed run. arguments, prepare: of
    `stepbus run`, and what happens before its start. takes_s: how long it takes until the fault
    strikes [s]. leaves: what may stay in the folder for temporary files, since no process is left
    to remove it.
    """

    strike: Strike | None = None
    codes: frozenset[int] = DONE
    blames: Literal["hit", "nobody", "any"] = "nobody"
    when: tuple[str, ...] = EARLY
    endless: bool = False
    arguments: tuple[str, ...] = ()
    prepare: disks.Prepare | None = None
    takes_s: float = 0.0
    leaves: bool = False


def in_turn(*strikes: Strike) -> Strike:
    """Return a strike that is several, one after the other."""

    def strike(box: Sandbox, chance: random.Random) -> None:
        for one in strikes:
            one(box, chance)

    return strike


# --- signals --------------------------------------------------------------------------------


def to_participant(number: int) -> Strike:
    """Return a strike that sends a signal to a participant."""

    def strike(box: Sandbox, chance: random.Random) -> None:
        name = box.notes["hit"] = chance.choice(box.notes["participants"])
        _send(box, name, number)

    return strike


def to_reaper(number: int) -> Strike:
    """Return a strike that sends a signal to the reaper."""
    return lambda box, _chance: _send(box, "reaper", number)


def _send(box: Sandbox, role: str, number: int) -> None:
    if not box.wait_for(lambda: box.find(role), START_S):
        raise Missed
    process = box.find(role)
    with contextlib.suppress(psutil.Error, AttributeError):
        process.send_signal(number)  # type: ignore[union-attr]


def to_orchestrator(number: int) -> Strike:
    """Return a strike that sends a signal to the orchestrator."""
    return lambda box, _chance: box.orchestrator.send_signal(number)


def storm(*numbers: int) -> Strike:
    """Return a strike that sends the orchestrator up to six of these signals in half a second."""

    def strike(box: Sandbox, chance: random.Random) -> None:
        for _ in range(chance.randrange(1, 7)):
            box.orchestrator.send_signal(chance.choice(numbers))
            time.sleep(chance.uniform(0.0, 0.1))

    return strike


def pause(_box: Sandbox, _chance: random.Random) -> None:
    """Wait a second between two strikes."""
    time.sleep(1.0)


# --- strangers on the sockets and ports of a run --------------------------------------------


def stranger(
    *deeds: str, at: Callable[[Sandbox], list[str]] | None = None, nobody: bool = False
) -> Strike:
    """Return a strike that does one of these deeds.

    at: what it is done to; default: all sockets and ports of the run. nobody: as another user.
    """
    places = at or addresses

    def strike(box: Sandbox, chance: random.Random) -> None:
        if not box.wait_for(lambda: places(box), START_S):
            raise Missed
        words = [*(["--nobody"] if nobody else []), chance.choice(deeds), *places(box)]
        helper = subprocess.Popen(
            [sys.executable, str(_PROGRAM), *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        box.helpers.append(helper)
        if helper.stdout is not None:
            select.select([helper.stdout], [], [], _READY_S)
        if box.orchestrator.poll() == 0:
            raise Missed

    return strike


def tickets(box: Sandbox) -> list[str]:
    """Return the tickets of the participants, with their credentials."""
    return [str(path) for path in box.temporary.glob("stepbus-*/*.ticket")]


def called(box: Sandbox) -> list[str]:
    """Return the folder of the run once it can be called."""
    return [str(box.out)] if (box.out / ".live.json").exists() else []


def addresses(box: Sandbox) -> list[str]:
    """Return where the processes of a run listen."""
    ports = set()
    for process in box.processes():
        with contextlib.suppress(psutil.Error):
            links = process.net_connections("tcp")
            ports |= {link.laddr.port for link in links if link.status == psutil.CONN_LISTEN}
    paths = sorted(box.temporary.glob("stepbus-*/*.sock"))
    return [f"unixsock-stream/{path}" for path in paths] + [
        f"tcp/127.0.0.1:{port}" for port in sorted(ports)
    ]


FAULTS: dict[str, Fault] = {
    **{
        f"{number.name} to the orchestrator": Fault(
            strike=to_orchestrator(number), codes=STOPPED, endless=True,
        )
        for number in ENDING
    },
    "one of these, or several, at the end": Fault(
        strike=storm(*ENDING), codes=DONE | STOPPED, when=END,
    ),
    "stop a participant, kill the orchestrator": Fault(
        strike=in_turn(to_participant(signal.SIGSTOP), to_orchestrator(signal.SIGKILL)),
        codes=KILLED, endless=True,
    ),
    **{
        f"{number.name} to the reaper": Fault(strike=to_reaper(number))
        for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP)
    },
    "stop the reaper, then Ctrl-C": Fault(
        strike=in_turn(to_reaper(signal.SIGSTOP), to_orchestrator(signal.SIGINT)),
        codes=STOPPED, endless=True,
    ),
    "kill the reaper, then a participant": Fault(
        strike=in_turn(to_reaper(signal.SIGKILL), to_participant(signal.SIGKILL)),
        codes=DEAD, blames="hit", when=MIDDLE, endless=True,
    ),
    "kill the reaper and the orchestrator": Fault(
        strike=in_turn(to_reaper(signal.SIGKILL), to_orchestrator(signal.SIGKILL)),
        codes=KILLED, when=MIDDLE, endless=True, leaves=True,
    ),
    "the disk fills up": Fault(
        strike=disks.fill, codes=REFUSED, when=MIDDLE, endless=True,
        prepare=disks.small_disk("size=8m"),
    ),
    "the disk takes few files": Fault(
        prepare=disks.small_disk("size=64m,nr_inodes={}", 2, 14), codes=frozenset({0, 3, 8}),
        when=START, blames="any",
    ),
    "no room for temporary files": Fault(
        prepare=disks.small_temporary_disk, codes=frozenset({0, 1, 3, 4, 5, 7}), when=START,
        blames="any",
    ),
    "the folder is moved away": Fault(strike=disks.move_folder, codes=REFUSED, when=MIDDLE),
    "the logs are removed": Fault(strike=disks.remove_logs, when=MIDDLE),
    "the recording is cut": Fault(strike=disks.cut, codes=KEPT, when=MIDDLE),
    "the recording is replaced": Fault(
        strike=disks.replace("run.mcap"), codes=REFUSED, when=MIDDLE,
    ),
    "the recording is damaged": Fault(strike=disks.damage, codes=KEPT, when=MIDDLE),
    "the timing is replaced": Fault(
        strike=disks.replace("timing.mcap"), codes=KEPT, when=MIDDLE,
    ),
    "the address for calls is replaced": Fault(strike=disks.replace(".live.json"), when=MIDDLE),
    "result.json is a folder": Fault(prepare=disks.occupy_result, codes=KEPT, when=START),
    "the sockets are removed": Fault(
        strike=disks.remove_temporary_files, codes=ANY_END, blames="any",
    ),
    "few files (ulimit -n)": Fault(
        prepare=disks.limit(resource.RLIMIT_NOFILE, 5, 80), codes=LIMITED, when=START, blames="any",
    ),
    "small files (ulimit -f)": Fault(
        prepare=disks.limit(resource.RLIMIT_FSIZE, 1, 2000, 1024),
        codes=frozenset({0, 3, 4, 5, 8}), when=START, blames="any",
    ),
    "little memory (ulimit -v)": Fault(
        prepare=disks.limit(resource.RLIMIT_AS, 60, 2000, 1 << 20), codes=LIMITED, when=START,
        blames="any",
    ),
    "little processor time (ulimit -t)": Fault(
        prepare=disks.limit(resource.RLIMIT_CPU, 1, 4),
        codes=LIMITED | {-signal.SIGXCPU, -signal.SIGKILL}, when=START, endless=True,
        blames="any", takes_s=40.0,
    ),
    "a subscriber stops reading": Fault(strike=stranger("subscribe", "subscribe_with_qos")),
    "a subscriber stops reading, then Ctrl-C": Fault(
        strike=in_turn(
            stranger("subscribe", "subscribe_with_qos"), pause, to_orchestrator(signal.SIGINT)
        ),
        codes=STOPPED, when=MIDDLE, endless=True,
    ),
    "a subscriber with stolen credentials stops reading": Fault(
        strike=stranger("subscribe_stolen", at=tickets), codes=ANY_END, when=MIDDLE, blames="any",
    ),
    "a caller asks nonsense and stops reading": Fault(
        strike=stranger("call", at=called), when=MIDDLE,
    ),
    **{
        f"a stranger at the sockets: {deed}": Fault(strike=stranger(deed))
        for deed in ("intrude", "flood", "babble")
    },
    **{
        f"a stranger on TCP: {deed}": Fault(strike=stranger(deed), arguments=TCP)
        for deed in ("intrude", "flood", "babble")
    },
    "another user's nonsense on TCP": Fault(
        strike=stranger("babble", "intrude", nobody=True), when=MIDDLE,
        arguments=TCP,
    ),
    # Zenoh accepts ten refused connections a second: links may not get through (security.md).
    "another user's nonsense on TCP at the start": Fault(
        strike=stranger("babble", "intrude", nobody=True),
        codes=frozenset({0, 7}), when=START, arguments=TCP,
    ),
    "another user at the sockets": Fault(
        strike=stranger("subscribe", "intrude", "flood", nobody=True),
    ),
}  # fmt: skip
