"""Hosts on a bad network: a network namespace each, and a router between them.

Each host has a TUN device, `wan`, with an address of its own. The router, one process, passes
packets on between the devices, later, or not at all. All is made and removed by it: where the test
is killed, it ends with what runs on its hosts.
"""

import contextlib
import ctypes
import fcntl
import heapq
import itertools
import json
import os
import random
import select
import shutil
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from support.paths import TESTS

NETWORK = "10.9.0"
_NUMBERS = itertools.count()
_TUN = Path("/dev/net/tun")
_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x1, 0x1000
_NEWNET = 0x40000000
_LONGEST = 1 << 16
_AT_ONCE = 64


def why_not():
    """Return why this machine cannot have such hosts; empty: it can."""
    if os.getuid() != 0:
        return "only root can make network namespaces"
    if shutil.which("ip") is None:
        return "ip (iproute2) is not installed"
    try:
        _TUN.open("rb").close()
    except OSError as exc:
        return f"{_TUN}: {exc.strerror}"
    command = ["ip", "netns", "list"]
    listed = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    return listed.stderr.strip() if listed.returncode else ""  # it may complain of those of others


@pytest.fixture
def wan():
    """Return a function that makes hosts, as of `Wan`; they are removed after the test."""
    if reason := why_not():
        pytest.skip(f"no network namespaces: {reason}")
    with contextlib.ExitStack() as stack:
        yield lambda *given, **options: stack.enter_context(Wan(*given, **options))


class Wan:
    """So many hosts, and the network between them. seed: of what is lost, and what is late."""

    def __init__(self, hosts, seed=0):
        prefix = f"sb{os.getpid()}-{next(_NUMBERS)}-"
        self.names = [f"{prefix}{host}" for host in range(hosts)]
        self.addresses = [address_of(host) for host in range(hosts)]
        self._processes = []
        self._router = subprocess.Popen(
            [sys.executable, "-m", "support.wan", str(seed), *self.names],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=TESTS,
            start_new_session=True,
        )
        answer = self._router.stdout.readline()
        if answer != "up\n":
            self.__exit__()
            pytest.skip(f"no network namespaces: {answer or 'the router has ended'}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        """End what is left on the hosts, and remove them."""
        self._router.stdin.close()
        self._router.wait()
        self._router.stdout.close()
        for process in self._processes:
            process.wait(20)

    def start(self, host, *command, **options):
        """Start a command on a host; return its process."""
        command = ["ip", "netns", "exec", self.names[host], *map(str, command)]
        options = {"stdin": subprocess.DEVNULL, "start_new_session": True, **options}
        self._processes.append(psutil.Popen(command, **options))
        return self._processes[-1]

    def pids(self, host):
        """Return the process ids of what runs on a host."""
        ask = ["ip", "netns", "pids", self.names[host]]
        return [int(pid) for pid in subprocess.check_output(ask, timeout=60).split()]

    def shape(self, delay_s=0.0, jitter_s=0.0, loss=0.0):
        """Have each packet late by `delay_s` ± `jitter_s`; lose a share of them."""
        self._ask(delay_s=delay_s, jitter_s=jitter_s, loss=loss)

    def cut(self, *hosts):
        """Lose all packets from and to these hosts, and no others any more."""
        self._ask(down=hosts)

    def counts(self):
        """Return how many packets were passed on, and how many were lost."""
        return self._ask()

    def _ask(self, **changes):
        print(json.dumps(changes), file=self._router.stdin, flush=True)
        return json.loads(self._router.stdout.readline())


def address_of(host):
    return f"{NETWORK}.{host + 1}"


# --- the router -------------------------------------------------------------------------------


class _Router:
    def __init__(self, seed, devices):
        self._devices = devices
        self._hosts = {device: host for host, device in enumerate(devices)}
        self._chance = random.Random(seed)
        self._due = []
        self._number = itertools.count()
        self._shape = {"delay_s": 0.0, "jitter_s": 0.0, "loss": 0.0, "down": ()}
        self.passed = self.lost = 0

    def work(self):
        """Pass packets on until standard input closes."""
        while True:
            wait_s = max(self._due[0][0] - time.monotonic(), 0.0) if self._due else None
            ready, _, _ = select.select([0, *self._devices], [], [], wait_s)
            for device in ready:
                if device:
                    self._read(device)
                elif not self._obey():
                    return
            while self._due and self._due[0][0] <= time.monotonic():
                _, _, packet, source = heapq.heappop(self._due)
                self._pass_on(packet, source)

    def _obey(self):
        line = sys.stdin.readline()
        if line:
            self._shape |= json.loads(line)
            print(json.dumps({"passed": self.passed, "lost": self.lost}), flush=True)
        return bool(line)

    def _read(self, device):
        """Take the packets that a host has sent; each is drawn anew, so they may overtake."""
        delay_s, jitter_s, loss = (self._shape[key] for key in ("delay_s", "jitter_s", "loss"))
        with contextlib.suppress(BlockingIOError):
            for _ in range(_AT_ONCE):
                packet = os.read(device, _LONGEST)
                source = self._hosts[device]
                if loss and self._chance.random() < loss:
                    self.lost += 1
                elif not delay_s and not jitter_s:
                    self._pass_on(packet, source)
                else:
                    late_s = delay_s + jitter_s * (2 * self._chance.random() - 1)
                    due = time.monotonic() + late_s, next(self._number), packet, source
                    heapq.heappush(self._due, due)

    def _pass_on(self, packet, source):
        """Write an IPv4 packet to the device of its destination, the last byte of whose address says the host."""
        host = packet[19] - 1
        is_ours = packet[0] >> 4 == 4 and host in range(len(self._devices))
        if not is_ours or {source, host} & set(self._shape["down"]):
            self.lost += is_ours
            return
        self.passed += 1
        # Where its queue is full, it is lost.
        with contextlib.suppress(OSError):
            os.write(self._devices[host], packet)


def _ip(*words):
    """Run `ip`; where that fails, end with what it says."""
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(print(f"ip {' '.join(words)}: {done.stderr.strip()}"))


def _enter(namespace):
    with Path(namespace).open("rb") as file:
        # `os.setns` is new in Python 3.12.
        if ctypes.CDLL(None).setns(file.fileno(), _NEWNET):
            sys.exit(print(f"the network namespace {namespace} cannot be entered"))


def _device(name, host):
    """Return the descriptor of a new TUN device on a host; it stays there."""
    _enter(f"/run/netns/{name}")
    device = os.open(_TUN, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH", b"wan", _IFF_TUN | _IFF_NO_PI))
    _enter(f"/proc/{os.getppid()}/ns/net")
    _ip("-n", name, "addr", "add", f"{address_of(host)}/24", "dev", "wan")
    _ip("-n", name, "link", "set", "wan", "txqueuelen", "10000", "up")
    _ip("-n", name, "link", "set", "lo", "up")
    return device


def main(seed, names):
    """Make hosts, route between them until standard input closes, remove them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        for name in names:
            _ip("netns", "add", name)
        router = _Router(seed, [_device(name, host) for host, name in enumerate(names)])
        print("up", flush=True)
        router.work()
    finally:
        for name in filter(lambda name: Path(f"/run/netns/{name}").exists(), names):
            for pid in subprocess.check_output(["ip", "netns", "pids", name]).split():
                # It may have ended meanwhile.
                with contextlib.suppress(ProcessLookupError):
                    os.kill(int(pid), signal.SIGKILL)
            _ip("netns", "del", name)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
