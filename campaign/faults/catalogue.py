"""Every type of fault from outside: a row says what strikes when, and what may come of it.

What the simulator has too is not here, but for what needs a real kernel.
"""

from __future__ import annotations

import signal

from . import disks, signals, strangers, streams
from .fault import ANY_END, Fault, in_turn

START, MIDDLE, END, EARLY = ("start",), ("middle",), ("end",), ("start", "middle")
TCP = ("--set", "bus.transport=tcp")
DEAD = frozenset({3, 5})
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LIMITED = frozenset({0, 1, 3, 4, 5, 6, 7, 8, 9})
"""A process may meet a limit anywhere."""
KEPT = frozenset({0, 8})
"""A file may be hit where nothing has been written for good; then the recording must be whole."""

ORCHESTRATOR = {
    "Ctrl-C, SIGTERM or SIGHUP": Fault(
        strike=signals.to_orchestrator(*ENDING), codes=frozenset({130}), when=EARLY, cases=3,
    ),
    "several of these at once": Fault(
        strike=signals.storm(*ENDING), codes=frozenset({130}), when=EARLY,
    ),
    "one of these, or several, at the end": Fault(
        strike=signals.storm(*ENDING), codes=frozenset({0, 130}), when=END, endless=False, cases=2,
    ),
    "stop a participant, kill the orchestrator": Fault(
        strike=in_turn(
            signals.to_participant(signal.SIGSTOP), signals.to_orchestrator(signal.SIGKILL)
        ),
        codes=frozenset({-signal.SIGKILL}), when=EARLY,
    ),
}  # fmt: skip
REAPER = {
    "kill, terminate or stop the reaper": Fault(
        strike=signals.to_reaper(signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP),
        codes=frozenset({0}), endless=False, when=EARLY, cases=3,
    ),
    "stop the reaper, then Ctrl-C": Fault(
        strike=in_turn(signals.to_reaper(signal.SIGSTOP), signals.to_orchestrator(signal.SIGINT)),
        codes=frozenset({130}), when=EARLY,
    ),
    "kill the reaper, then a participant": Fault(
        strike=in_turn(signals.to_reaper(signal.SIGKILL), signals.to_participant(signal.SIGKILL)),
        codes=DEAD, blames="hit", when=MIDDLE,
    ),
    "kill the reaper and the orchestrator": Fault(
        strike=in_turn(signals.to_reaper(signal.SIGKILL), signals.to_orchestrator(signal.SIGKILL)),
        codes=frozenset({-signal.SIGKILL}), when=MIDDLE, leaves=True,
    ),
}  # fmt: skip
DISKS = {
    "the disk fills up": Fault(
        strike=disks.fill, codes=frozenset({8}), when=MIDDLE, prepare=disks.own_disk,
    ),
    "the disk is full of logs": Fault(
        prepare=disks.small_disk, codes=frozenset({3, 4, 5, 8}), when=START,
        environment={"PYTHONVERBOSE": "1"}, blames="any", takes_s=60.0,
    ),
    "the disk takes few files": Fault(
        prepare=disks.few_inodes, codes=frozenset({0, 3, 8}), when=START, endless=False,
        blames="any",
    ),
    "no room for temporary files": Fault(
        prepare=disks.small_temporary_disk, codes=frozenset({0, 1, 3, 4, 5, 7}), when=START,
        endless=False, blames="any",
    ),
    "the folder is moved away": Fault(
        strike=disks.move_folder, codes=frozenset({8}), endless=False, when=MIDDLE,
    ),
    "the logs are removed": Fault(
        strike=disks.remove_logs, codes=frozenset({0}), endless=False, when=MIDDLE,
    ),
    "the recording is cut": Fault(
        strike=disks.cut, codes=KEPT, endless=False, when=MIDDLE,
    ),
    "the recording is replaced": Fault(
        strike=disks.replace("run.mcap"), codes=frozenset({8}), endless=False, when=MIDDLE,
    ),
    "the recording is damaged": Fault(
        strike=disks.damage, codes=KEPT, endless=False, when=MIDDLE,
    ),
    "the timing is replaced": Fault(
        strike=disks.replace("timing.mcap"), codes=KEPT, endless=False, when=MIDDLE,
    ),
    "the address for calls is replaced": Fault(
        strike=disks.replace(".live.json"), codes=frozenset({0}), endless=False, when=MIDDLE,
    ),
    "result.json is a folder": Fault(
        prepare=disks.occupy_result, codes=KEPT, endless=False, when=START,
    ),
    "the sockets are removed": Fault(
        strike=disks.remove_temporary_files, codes=ANY_END, endless=False, when=EARLY, blames="any",
    ),
}  # fmt: skip
STREAMS = {
    "stdout is a closed pipe": Fault(
        codes=frozenset({0}), endless=False, when=START, stdout="closed",
    ),
    "nobody reads stdout": Fault(
        codes=frozenset({0}), endless=False, when=START, stdout="unread",
    ),
    "nobody reads the terminal": Fault(
        codes=frozenset({0}), endless=False, when=START, stdout="full terminal",
    ),
    "the reader of stdout goes": Fault(
        strike=streams.close_reader, codes=frozenset({0}), endless=False, when=EARLY, stdout="pipe",
    ),
    "the terminal goes": Fault(
        strike=streams.close_reader, codes=frozenset({0, 130}), endless=False, when=EARLY,
        stdout="terminal",
    ),
    "stderr is closed, stdout full": Fault(
        codes=frozenset({0}), endless=False, when=START, stderr="closed", stdout="full",
    ),
    "a failure into a closed pipe": Fault(
        strike=signals.to_participant(signal.SIGKILL), codes=DEAD, when=MIDDLE, stdout="closed",
        blames="hit",
    ),
    "a failure that nobody reads": Fault(
        strike=signals.to_participant(signal.SIGKILL), codes=DEAD, when=MIDDLE, stdout="unread",
        stderr="unread", blames="hit", takes_s=2.0,
    ),
}  # fmt: skip
LIMITS = {
    "few files (ulimit -n)": Fault(
        prepare=disks.few_files, codes=LIMITED, endless=False, when=START, blames="any",
    ),
    "small files (ulimit -f)": Fault(
        prepare=disks.small_files, codes=frozenset({0, 3, 4, 5, 8}), endless=False, when=START,
        blames="any",
    ),
    "little memory (ulimit -v)": Fault(
        prepare=disks.little_memory, codes=LIMITED, endless=False, when=START, blames="any",
    ),
    "little processor time (ulimit -t)": Fault(
        prepare=disks.little_time, codes=LIMITED | {-signal.SIGXCPU, -signal.SIGKILL}, when=START,
        blames="any", takes_s=40.0,
    ),
}  # fmt: skip
STRANGERS = {
    "a subscriber stops reading": Fault(
        strike=strangers.deed("subscribe", "subscribe_with_qos"), codes=frozenset({0}),
        endless=False, when=EARLY, cases=2,
    ),
    "a subscriber stops reading, then Ctrl-C": Fault(
        strike=in_turn(
            strangers.deed("subscribe", "subscribe_with_qos"), signals.pause,
            signals.to_orchestrator(signal.SIGINT),
        ),
        codes=frozenset({130}), when=MIDDLE,
    ),
    "a subscriber with stolen credentials stops reading": Fault(
        strike=strangers.with_tickets, codes=ANY_END, endless=False, when=MIDDLE, blames="any",
    ),
    "a caller asks nonsense and stops reading": Fault(
        strike=strangers.as_caller, codes=frozenset({0}), endless=False, when=MIDDLE,
    ),
    "strangers at the sockets": Fault(
        strike=strangers.deed("intrude", "flood", "half_handshake", "babble"), codes=frozenset({0}),
        endless=False, when=EARLY, cases=4,
    ),
    "strangers on TCP": Fault(
        strike=strangers.deed("intrude", "idle", "half_handshake"), codes=frozenset({0}),
        endless=False, when=EARLY, arguments=TCP, cases=3,
    ),
    "a flood of connections on TCP": Fault(
        strike=strangers.deed("flood"), codes=frozenset({0}), endless=False, when=MIDDLE,
        arguments=TCP,
    ),
    "another user's nonsense on TCP": Fault(
        strike=strangers.deed("babble", "intrude", "half_handshake", nobody=True),
        codes=frozenset({0}), endless=False, when=MIDDLE, arguments=TCP,
    ),
    # Zenoh accepts ten refused connections a second: links may not get through (security.md).
    "another user's nonsense on TCP at the start": Fault(
        strike=strangers.deed("babble", "intrude", "half_handshake", nobody=True),
        codes=frozenset({0, 7}), endless=False, when=START, arguments=TCP,
    ),
    "another user at the sockets": Fault(
        strike=strangers.deed("subscribe", "intrude", "flood", nobody=True), codes=frozenset({0}),
        endless=False, when=EARLY,
    ),
}  # fmt: skip

FAULTS = ORCHESTRATOR | REAPER | DISKS | STREAMS | LIMITS | STRANGERS
