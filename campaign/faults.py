"""Faults that strike a run from outside, and what must come of each.

Each is a function that strikes, and a row of `FAULTS`, which says what the run may do then.
"""

from __future__ import annotations

import contextlib
import os
import random
import resource
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import psutil

from .sandbox import Sandbox

Strike = Callable[[Sandbox, random.Random], None]
ANY_END = frozenset({0, 3, 4, 5, 6, 7, 8, 9, 130})


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One type of fault.

    strike: does it, given the sandbox and a source of chance. codes: exit codes the run may end
    with; a negative one is a signal. blames: the run must name the participant that was hit.
    when: the moments at which it may strike. endless: the run ends only by the fault; otherwise
    it must finish by itself. arguments, prepare: of `stepbus run`, and what happens before
    its start. stdout: where it goes. takes_s: how long it takes until the fault strikes [s].
    """

    strike: Strike
    codes: frozenset[int]
    blames: bool = False
    when: tuple[str, ...]
    endless: bool = True
    arguments: tuple[str, ...] = ()
    prepare: Callable[[Sandbox, random.Random], Callable[[], None] | None] | None = None
    stdout: str = "file"
    takes_s: float = 0.0


def _signal_participant(number: int) -> Strike:
    def strike(box: Sandbox, chance: random.Random) -> None:
        name = chance.choice(box.notes["participants"])
        box.notes["hit"] = name
        box.wait_for(lambda: box.find(name), 5.0)
        _send(box.find(name), number)

    return strike


def _signal_orchestrator(number: int) -> Strike:
    def strike(box: Sandbox, _chance: random.Random) -> None:
        box.orchestrator.send_signal(number)

    return strike


def _signal_reaper(number: int) -> Strike:
    def strike(box: Sandbox, _chance: random.Random) -> None:
        box.wait_for(lambda: box.find("reaper"), 5.0)
        _send(box.find("reaper"), number)

    return strike


def _in_turn(*strikes: Strike) -> Strike:
    """Return a fault that is several, one after the other."""

    def strike(box: Sandbox, chance: random.Random) -> None:
        for one in strikes:
            one(box, chance)

    return strike


def _pause(_box: Sandbox, _chance: random.Random) -> None:
    time.sleep(1.0)


def _send(process: psutil.Process | None, number: int) -> None:
    if process is not None:
        with contextlib.suppress(psutil.Error):
            process.send_signal(number)


def _suspend_orchestrator(box: Sandbox, chance: random.Random) -> None:
    """Stop the orchestrator for longer than any deadline, then let it continue."""
    box.orchestrator.send_signal(signal.SIGSTOP)
    time.sleep(chance.uniform(2.5, 4.0))
    box.orchestrator.send_signal(signal.SIGCONT)


def _remove_folder(box: Sandbox, _chance: random.Random) -> None:
    shutil.rmtree(box.out, ignore_errors=True)


def _truncate(box: Sandbox, chance: random.Random) -> None:
    recording = box.out / "run.mcap"
    box.wait_for(recording.exists, 5.0)
    with contextlib.suppress(OSError):
        os.truncate(recording, chance.randrange(recording.stat().st_size + 1))


def _replace(box: Sandbox, _chance: random.Random) -> None:
    recording = box.out / "run.mcap"
    box.wait_for(recording.exists, 5.0)
    with contextlib.suppress(OSError):
        recording.unlink()
        recording.write_bytes(b"somebody else's")


def _small_disk(box: Sandbox, chance: random.Random) -> Callable[[], None] | None:
    """Put the run's folder on a file system of a random size, or limit the size of its files."""
    kib = chance.randrange(700, 6000)
    box.notes["stepping_bytes"] = 1 << 40
    command = ["mount", "-t", "tmpfs", "-o", f"size={kib}k", "none", str(box.home / "disk")]
    if (
        os.geteuid() == 0
        and subprocess.run(command, capture_output=True, check=False).returncode == 0
    ):
        return None
    limit = kib * 1024
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))


def _few_files(_box: Sandbox, chance: random.Random) -> Callable[[], None]:
    number = chance.randrange(5, 40)
    return lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (number, number))


def _wait(_box: Sandbox, _chance: random.Random) -> None:
    """Do nothing: what was prepared is the fault."""


_SUBSCRIBER = """
import os, signal, sys, time, json, zenoh
config = zenoh.Config()
for key, value in {
    "mode": "peer", "connect/endpoints": [sys.argv[1]], "listen/endpoints": [],
    "scouting/multicast/enabled": False, "scouting/gossip/enabled": False,
    "transport/unicast/qos/enabled": sys.argv[2] != "low",
    "transport/unicast/lowlatency": sys.argv[2] == "low",
}.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
subscriber = session.declare_subscriber("**", lambda sample: None)
time.sleep(0.3)
print("listening", flush=True)
os.kill(os.getpid(), signal.SIGSTOP)
"""


def _stopped_subscriber(box: Sandbox, chance: random.Random) -> None:
    """Subscribe to everything on a socket of the run, then stop reading."""
    sockets = sorted(box.temporary.glob("stepbus-*/*.sock"))
    if not sockets:
        return
    address = f"unixsock-stream/{sockets[chance.choice((0, 0, -1))]}"
    helper = subprocess.Popen(
        [sys.executable, "-c", _SUBSCRIBER, address, chance.choice(("low", "low", "other"))],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    box.helpers.append(helper)
    if helper.stdout is not None:
        box.notes["subscriber"] = helper.stdout.readline().strip()


def _idle_connections(box: Sandbox, chance: random.Random) -> None:
    """Open TCP connections to every port of the run, and say nothing, or nonsense."""
    held = box.notes.setdefault("sockets", [])
    for port in _ports(box):
        for _ in range(chance.randrange(1, 8)):
            with contextlib.suppress(OSError):
                link = socket.create_connection(("127.0.0.1", port), timeout=1.0)
                held.append(link)
                if chance.random() < 0.5:
                    link.sendall(chance.randbytes(chance.randrange(1, 4000)))


def _ports(box: Sandbox) -> set[int]:
    ports = set()
    for process in box.processes():
        with contextlib.suppress(psutil.Error):
            for link in process.net_connections("tcp"):
                if link.status == psutil.CONN_LISTEN:
                    ports.add(link.laddr.port)
    return ports


_INTRUDER = """
import sys, time, json, zenoh
config = zenoh.Config()
for key, value in {
    "mode": "peer", "connect/endpoints": sys.argv[1:], "listen/endpoints": [],
    "connect/timeout_ms": 3000, "connect/exit_on_failure": False,
    "scouting/multicast/enabled": False, "scouting/gossip/enabled": False,
    "transport/unicast/qos/enabled": False, "transport/unicast/lowlatency": True,
}.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
for _ in range(400):
    for key in ("trigger", "stop", "start", "ready/plant", "fault/plant", "log/plant", "out/plant"):
        session.put(key, b"\\x81\\xa5token\\xa1x")
        session.put("stepbus/" + key, b"garbage")
    time.sleep(0.005)
session.close()
"""


def _intruder(box: Sandbox, _chance: random.Random) -> None:
    """Publish on every key of the run, without its secrets."""
    addresses = [f"tcp/127.0.0.1:{port}" for port in _ports(box)]
    addresses += [f"unixsock-stream/{path}" for path in box.temporary.glob("stepbus-*/*.sock")]
    if addresses:
        quiet = subprocess.DEVNULL
        command = [sys.executable, "-c", _INTRUDER, *addresses]
        box.helpers.append(subprocess.Popen(command, stdout=quiet, stderr=quiet))


def _fill_log(box: Sandbox, _chance: random.Random) -> None:
    """Take the space of the run's folder away while it runs."""
    with contextlib.suppress(OSError), (box.home / "disk" / "ballast").open("wb") as file:
        while True:
            file.write(bytes(4096))
            file.flush()


def _remove_sockets(box: Sandbox, _chance: random.Random) -> None:
    for folder in box.temporary.glob("stepbus-*"):
        shutil.rmtree(folder, ignore_errors=True)


def _own_disk(box: Sandbox, _chance: random.Random) -> Callable[[], None] | None:
    if _mount(box, "size=8m"):
        return None
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))


def _mount(box: Sandbox, size: str) -> bool:
    command = ["mount", "-t", "tmpfs", "-o", size, "none", str(box.home / "disk")]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


START, MIDDLE, EARLY = ("start",), ("middle",), ("start", "middle")
TCP = ("--set", "bus.transport=tcp")

FAULTS: dict[str, Fault] = {
    "kill a participant": Fault(
        strike=_signal_participant(signal.SIGKILL), codes=frozenset({3, 5}), blames=True,
        when=EARLY,
    ),
    "terminate a participant": Fault(
        strike=_signal_participant(signal.SIGTERM), codes=frozenset({3, 5}), blames=True,
        when=EARLY,
    ),
    "crash a participant": Fault(
        strike=_signal_participant(signal.SIGSEGV), codes=frozenset({3, 5}), blames=True,
        when=EARLY,
    ),
    "stop a participant": Fault(
        strike=_signal_participant(signal.SIGSTOP), codes=frozenset({3, 6}), blames=True,
        when=EARLY,
    ),
    "hit a participant at the end": Fault(
        strike=_signal_participant(signal.SIGSTOP), codes=frozenset({0, 3, 5, 6, 9}),
        when=("end",), endless=False,
    ),
    "Ctrl-C": Fault(
        strike=_signal_orchestrator(signal.SIGINT), codes=frozenset({130}), when=EARLY,
    ),
    "SIGTERM": Fault(
        strike=_signal_orchestrator(signal.SIGTERM), codes=frozenset({130}), when=EARLY,
    ),
    "SIGHUP": Fault(
        strike=_signal_orchestrator(signal.SIGHUP), codes=frozenset({130}), when=EARLY,
    ),
    "Ctrl-C at the end": Fault(
        strike=_signal_orchestrator(signal.SIGINT), codes=frozenset({0, 130}),
        when=("end",), endless=False,
    ),
    "SIGTERM at the end": Fault(
        strike=_signal_orchestrator(signal.SIGTERM), codes=frozenset({0, 130}),
        when=("end",), endless=False,
    ),
    "kill the orchestrator": Fault(
        strike=_signal_orchestrator(signal.SIGKILL), codes=frozenset({-9}), when=EARLY,
    ),
    "suspend the orchestrator": Fault(
        strike=_suspend_orchestrator, codes=frozenset({0}), endless=False, when=EARLY,
    ),
    "kill the reaper": Fault(
        strike=_signal_reaper(signal.SIGKILL), codes=frozenset({0}), endless=False,
        when=EARLY,
    ),
    "stop the reaper": Fault(
        strike=_signal_reaper(signal.SIGSTOP), codes=frozenset({0}), endless=False,
        when=EARLY,
    ),
    "stop the reaper, then Ctrl-C": Fault(
        strike=_in_turn(_signal_reaper(signal.SIGSTOP), _signal_orchestrator(signal.SIGINT)),
        codes=frozenset({130}), when=("middle",),
    ),
    "a subscriber stops reading": Fault(
        strike=_stopped_subscriber, codes=frozenset({0}), endless=False, when=MIDDLE,
    ),
    "a subscriber stops reading, then Ctrl-C": Fault(
        strike=_in_turn(_stopped_subscriber, _pause, _signal_orchestrator(signal.SIGINT)),
        codes=frozenset({0, 130}), when=MIDDLE,
    ),
    "the disk is full": Fault(
        strike=_wait, prepare=_small_disk, codes=frozenset({8}), when=START, takes_s=60.0,
    ),
    "the disk fills up": Fault(
        strike=_fill_log, codes=frozenset({8}), when=MIDDLE,
        prepare=_own_disk,
    ),
    "the folder is removed": Fault(
        strike=_remove_folder, codes=frozenset({8}), endless=False, when=MIDDLE,
    ),
    "the recording is cut": Fault(
        strike=_truncate, codes=frozenset({8}), endless=False, when=MIDDLE,
    ),
    "the recording is replaced": Fault(
        strike=_replace, codes=frozenset({8}), endless=False, when=MIDDLE,
    ),
    "the sockets are removed": Fault(
        strike=_remove_sockets, codes=ANY_END, endless=False, when=EARLY,
    ),
    "few files": Fault(
        strike=_wait, prepare=_few_files, codes=frozenset({0, 1, 3, 7, 8}), endless=False,
        when=START,
    ),
    "stdout is a closed pipe": Fault(
        strike=_wait, codes=frozenset({0}), endless=False, when=START, stdout="closed",
    ),
    "stdout is full": Fault(
        strike=_wait, codes=frozenset({0}), endless=False, when=START, stdout="full",
    ),
    "nobody reads stdout": Fault(
        strike=_wait, codes=frozenset({0}), endless=False, when=START, stdout="unread",
    ),
    "nobody reads the terminal": Fault(
        strike=_wait, codes=frozenset({0}), endless=False, when=START, stdout="terminal",
    ),
    "a failure into a closed pipe": Fault(
        strike=_signal_participant(signal.SIGKILL), codes=frozenset({3, 5}), when=MIDDLE,
        stdout="closed", blames=True,
    ),
    "idle connections": Fault(
        strike=_idle_connections, codes=frozenset({0}), endless=False, when=EARLY,
        arguments=TCP,
    ),
    "an intruder on TCP": Fault(
        strike=_intruder, codes=frozenset({0}), endless=False, when=EARLY,
        arguments=TCP,
    ),
    "an intruder on the socket": Fault(
        strike=_intruder, codes=frozenset({0}), endless=False, when=EARLY,
    ),
}  # fmt: skip


def stdout_of(name: str) -> tuple[int | None, list[int]]:
    """Return the descriptor for the run's stdout, and those to close after the run."""
    if name == "file":
        return None, []
    if name == "full":
        descriptor = os.open("/dev/full", os.O_WRONLY)
        return descriptor, [descriptor]
    if name == "terminal":
        master, slave = os.openpty()
        return slave, [master, slave]
    read, write = os.pipe()
    if name == "closed":
        os.close(read)
        return write, [write]
    os.set_blocking(write, True)
    with contextlib.suppress(BlockingIOError):
        # Nearly full, so that the first line of the run finds no room.
        os.set_blocking(write, False)
        while os.write(write, bytes(4096)):
            pass
    os.set_blocking(write, True)
    return write, [read, write]
