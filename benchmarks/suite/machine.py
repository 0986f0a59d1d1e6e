"""The machine that a benchmark runs on: without it, a figure says little."""

import os
import platform
import socket
import threading
import time
from pathlib import Path

_ROUND_TRIPS = 2000


def ping_pong_us() -> float:
    """Return the round trip of one byte between two threads over a Unix socket pair [µs]."""
    ours, theirs = socket.socketpair()

    def answer() -> None:
        with theirs:
            while data := theirs.recv(1):
                theirs.send(data)

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    start = time.perf_counter_ns()
    for _ in range(_ROUND_TRIPS):
        ours.send(b"x")
        ours.recv(1)
    spent = time.perf_counter_ns() - start
    ours.close()
    thread.join()
    return spent / _ROUND_TRIPS * 1e-3


def stolen_s() -> float:
    """Return the time that the host has taken from this machine since it started [s]."""
    fields = Path("/proc/stat").read_text().splitlines()[0].split()
    return int(fields[8]) / os.sysconf("SC_CLK_TCK")


def name() -> str:
    """Return processor, cores, system and Python in a line."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return (
        f"{models[0] if models else platform.machine()}, {os.cpu_count()} cores, "
        f"{platform.system()} {platform.release().partition('-')[0]}, "
        f"Python {platform.python_version()}"
    )
