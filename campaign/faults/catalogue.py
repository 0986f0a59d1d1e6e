"""Every type of fault from outside: a row says what strikes when, and what may come of it."""

from __future__ import annotations

import signal

from . import disks, limits, signals, strangers, streams
from .fault import ANY_END, Fault, in_turn, wait

START, MIDDLE, END, EARLY = ("start",), ("middle",), ("end",), ("start", "middle")
TCP = ("--set", "bus.transport=tcp")
DEAD = frozenset({3, 5})
FATAL = (signal.SIGSEGV, signal.SIGABRT, signal.SIGQUIT)
STOPPED = frozenset({3, 6})
LIMITED = frozenset({0, 1, 3, 4, 5, 6, 7, 8, 9})
"""A process may meet a limit anywhere."""
KEPT = frozenset({0, 8})
"""A file may be hit where nothing has been written for good; then the recording must be whole."""

PARTICIPANTS = {
    "kill a participant": Fault(
        strike=signals.to_participant(signal.SIGKILL), codes=DEAD, blames="hit", when=EARLY,
    ),
    "terminate a participant": Fault(
        strike=signals.to_participant(signal.SIGTERM, signal.SIGHUP, signal.SIGINT),
        codes=frozenset({3, 4, 5}), blames="hit", when=EARLY,
    ),
    "crash a participant": Fault(
        strike=signals.to_participant(*FATAL), codes=DEAD, blames="hit", when=EARLY,
    ),
    "stop a participant": Fault(
        strike=signals.to_participant(signal.SIGSTOP), codes=STOPPED, blames="hit", when=EARLY,
    ),
    "a participant stutters": Fault(
        strike=signals.stutter, codes=frozenset({0}), when=EARLY, endless=False, takes_s=2.0,
    ),
    "kill all participants": Fault(
        strike=signals.to_all_participants(signal.SIGKILL), codes=DEAD, blames="any", when=EARLY,
    ),
    "stop all participants": Fault(
        strike=signals.to_all_participants(signal.SIGSTOP), codes=STOPPED, blames="any",
        when=EARLY,
    ),
    "hit a participant at the end": Fault(
        strike=signals.to_participant(signal.SIGSTOP, signal.SIGKILL, signal.SIGTERM),
        codes=frozenset({0, 3, 5, 6, 9}), blames="hit", when=END, endless=False,
    ),
    "stop a participant, then Ctrl-C": Fault(
        strike=in_turn(
            signals.to_participant(signal.SIGSTOP), signals.to_orchestrator(signal.SIGINT)
        ),
        codes=frozenset({130, 3, 6, 9}), blames="hit", when=EARLY,
    ),
}  # fmt: skip
ORCHESTRATOR = {
    "Ctrl-C": Fault(
        strike=signals.to_orchestrator(signal.SIGINT), codes=frozenset({130}), when=EARLY,
    ),
    "SIGTERM": Fault(
        strike=signals.to_orchestrator(signal.SIGTERM), codes=frozenset({130}), when=EARLY,
    ),
    "SIGHUP": Fault(
        strike=signals.to_orchestrator(signal.SIGHUP), codes=frozenset({130}), when=EARLY,
    ),
    "several of these at once": Fault(
        strike=signals.storm(signal.SIGINT, signal.SIGTERM, signal.SIGHUP),
        codes=frozenset({130}), when=EARLY,
    ),
    "Ctrl-C at the end": Fault(
        strike=signals.to_orchestrator(signal.SIGINT), codes=frozenset({0, 130}), when=END,
        endless=False,
    ),
    "SIGTERM or SIGHUP at the end": Fault(
        strike=signals.to_orchestrator(signal.SIGTERM, signal.SIGHUP),
        codes=frozenset({0, 130}), when=END, endless=False,
    ),
    "several signals at the end": Fault(
        strike=signals.storm(signal.SIGINT, signal.SIGTERM, signal.SIGHUP),
        codes=frozenset({0, 130}), when=END, endless=False,
    ),
    "kill the orchestrator": Fault(
        strike=signals.to_orchestrator(signal.SIGKILL), codes=frozenset({-9}), when=EARLY,
    ),
    "crash the orchestrator": Fault(
        strike=signals.to_orchestrator(*FATAL), codes=frozenset({-number for number in FATAL}),
        when=EARLY,
    ),
    "stop a participant, kill the orchestrator": Fault(
        strike=in_turn(
            signals.to_participant(signal.SIGSTOP), signals.to_orchestrator(signal.SIGKILL)
        ),
        codes=frozenset({-9}), when=EARLY,
    ),
    "suspend the orchestrator": Fault(
        strike=signals.suspend_orchestrator, codes=frozenset({0}), endless=False, when=EARLY,
        takes_s=4.0,
    ),
}  # fmt: skip
REAPER = {
    "kill the reaper": Fault(
        strike=signals.to_reaper(signal.SIGKILL, *FATAL), codes=frozenset({0}), endless=False,
        when=EARLY,
    ),
    "terminate the reaper": Fault(
        strike=signals.to_reaper(signal.SIGTERM, signal.SIGINT, signal.SIGHUP),
        codes=frozenset({0}), endless=False, when=EARLY,
    ),
    "stop the reaper": Fault(
        strike=signals.to_reaper(signal.SIGSTOP), codes=frozenset({0}), endless=False, when=EARLY,
    ),
    "hit the reaper at the end": Fault(
        strike=signals.to_reaper(signal.SIGSTOP, signal.SIGKILL), codes=frozenset({0}),
        endless=False, when=END,
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
        codes=frozenset({-9}), when=MIDDLE, leaves=True,
    ),
}  # fmt: skip
DISKS = {
    "the disk is full": Fault(
        strike=wait, prepare=disks.small_disk, codes=frozenset({8}), when=START, takes_s=60.0,
    ),
    "the disk fills up": Fault(
        strike=disks.fill, codes=frozenset({8}), when=MIDDLE, prepare=disks.own_disk,
    ),
    "the disk is full of logs": Fault(
        strike=wait, prepare=disks.small_disk, codes=frozenset({3, 4, 5, 8}), when=START,
        environment={"PYTHONVERBOSE": "1"}, blames="any", takes_s=60.0,
    ),
    "the disk takes few files": Fault(
        strike=wait, prepare=disks.few_inodes, codes=frozenset({0, 3, 8}), when=START,
        endless=False, blames="any",
    ),
    "no room for temporary files": Fault(
        strike=wait, prepare=disks.small_temporary_disk, codes=frozenset({0, 1, 3, 4, 5, 7}),
        when=START, endless=False, blames="any",
    ),
    "the folder is removed": Fault(
        strike=disks.remove_folder, codes=frozenset({8}), endless=False, when=MIDDLE,
    ),
    "the folder is moved away": Fault(
        strike=disks.move_folder, codes=frozenset({8}), endless=False, when=MIDDLE,
    ),
    "the logs are removed": Fault(
        strike=disks.remove_logs, codes=frozenset({0}), endless=False, when=MIDDLE,
    ),
    "the recording is cut": Fault(
        strike=disks.truncate("run.mcap"), codes=KEPT, endless=False, when=MIDDLE,
    ),
    "the recording is replaced": Fault(
        strike=disks.replace("run.mcap"), codes=frozenset({8}), endless=False, when=MIDDLE,
    ),
    "the recording is damaged": Fault(
        strike=disks.damage, codes=KEPT, endless=False, when=MIDDLE,
    ),
    "the timing is cut or replaced": Fault(
        strike=disks.replace("timing.mcap"), codes=KEPT, endless=False, when=MIDDLE,
    ),
    "the address for calls is replaced": Fault(
        strike=disks.replace(".live.json"), codes=frozenset({0}), endless=False, when=MIDDLE,
    ),
    "result.json is a folder": Fault(
        strike=wait, prepare=disks.occupy("result.json"), codes=KEPT, endless=False, when=START,
    ),
    "the sockets are removed": Fault(
        strike=disks.remove_temporary_files, codes=ANY_END, endless=False, when=EARLY,
        blames="any",
    ),
}  # fmt: skip
STREAMS = {
    "stdout is a closed pipe": Fault(
        strike=wait, codes=frozenset({0}), endless=False, when=START, stdout="closed",
    ),
    "stdout is full": Fault(
        strike=wait, codes=frozenset({0}), endless=False, when=START, stdout="full",
    ),
    "nobody reads stdout": Fault(
        strike=wait, codes=frozenset({0}), endless=False, when=START, stdout="unread",
    ),
    "nobody reads the terminal": Fault(
        strike=wait, codes=frozenset({0}), endless=False, when=START, stdout="full terminal",
    ),
    "the reader of stdout goes": Fault(
        strike=streams.close_reader, codes=frozenset({0}), endless=False, when=EARLY,
        stdout="pipe",
    ),
    "the terminal goes": Fault(
        strike=streams.close_reader, codes=frozenset({0, 130}), endless=False, when=EARLY,
        stdout="terminal",
    ),
    "stderr is closed or full": Fault(
        strike=wait, codes=frozenset({0}), endless=False, when=START, stderr="closed",
        stdout="full",
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
        strike=wait, prepare=limits.few_files, codes=LIMITED, endless=False, when=START,
        blames="any",
    ),
    "small files (ulimit -f)": Fault(
        strike=wait, prepare=limits.small_files, codes=frozenset({0, 3, 4, 5, 8}), endless=False,
        when=START, blames="any",
    ),
    "little memory (ulimit -v)": Fault(
        strike=wait, prepare=limits.little_memory, codes=LIMITED, endless=False, when=START,
        blames="any",
    ),
    "little processor time (ulimit -t)": Fault(
        strike=wait, prepare=limits.little_time,
        codes=LIMITED | {-signal.SIGXCPU, -signal.SIGKILL}, when=START, blames="any",
        takes_s=40.0,
    ),
    "few processes (ulimit -u)": Fault(
        strike=wait, prepare=limits.few_processes, codes=LIMITED, endless=False, when=START,
        blames="any", takes_s=10.0,
    ),
}  # fmt: skip
STRANGERS = {
    "a subscriber stops reading": Fault(
        strike=strangers.deed("subscribe", "subscribe_with_qos"), codes=frozenset({0}),
        endless=False, when=EARLY,
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
    "an intruder on the sockets": Fault(
        strike=strangers.deed("intrude"), codes=frozenset({0}), endless=False, when=EARLY,
    ),
    "an intruder on TCP": Fault(
        strike=strangers.deed("intrude"), codes=frozenset({0}), endless=False, when=EARLY,
        arguments=TCP,
    ),
    "connections that say nothing": Fault(
        strike=strangers.deed("idle", "flood"), codes=frozenset({0}), endless=False, when=EARLY,
    ),
    "connections on TCP that say nothing": Fault(
        strike=strangers.deed("idle"), codes=frozenset({0}), endless=False, when=EARLY,
        arguments=TCP,
    ),
    "a flood of connections on TCP": Fault(
        strike=strangers.deed("flood"), codes=frozenset({0}), endless=False, when=MIDDLE,
        arguments=TCP,
    ),
    "half handshakes": Fault(
        strike=strangers.deed("half_handshake"), codes=frozenset({0}), endless=False, when=EARLY,
    ),
    "half handshakes on TCP": Fault(
        strike=strangers.deed("half_handshake"), codes=frozenset({0}), endless=False, when=EARLY,
        arguments=TCP,
    ),
    "nonsense on the sockets": Fault(
        strike=strangers.deed("babble", "hang_up"), codes=frozenset({0}), endless=False,
        when=EARLY,
    ),
    "another user's nonsense on TCP": Fault(
        strike=strangers.deed("babble", "hang_up", "intrude", "half_handshake", nobody=True),
        codes=frozenset({0}), endless=False, when=MIDDLE, arguments=TCP,
    ),
    # Zenoh accepts ten refused connections a second: links may not get through (security.md).
    "another user's nonsense on TCP at the start": Fault(
        strike=strangers.deed("babble", "hang_up", "intrude", "half_handshake", nobody=True),
        codes=frozenset({0, 7}), endless=False, when=START, arguments=TCP, blames="nobody",
    ),
    "another user at the sockets": Fault(
        strike=strangers.deed("subscribe", "intrude", "flood", nobody=True),
        codes=frozenset({0}), endless=False, when=EARLY,
    ),
}  # fmt: skip

GROUPS = {
    "a participant": PARTICIPANTS,
    "the orchestrator": ORCHESTRATOR,
    "the reaper": REAPER,
    "files and disks": DISKS,
    "standard streams": STREAMS,
    "limits": LIMITS,
    "strangers": STRANGERS,
}  # fmt: skip
FAULTS = {name: fault for group in GROUPS.values() for name, fault in group.items()}
