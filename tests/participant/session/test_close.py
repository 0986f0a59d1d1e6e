"""A session closes in time, also while a process that reads nothing blocks a put."""

import contextlib
import signal
import subprocess
import sys
import threading
import time

import pytest
import zenoh

from stepbus_participant import Endpoint, ZenohBus

READER = """
import sys, time
from stepbus_participant import Endpoint, ZenohBus
bus = ZenohBus(Endpoint(listen=[sys.argv[1]], connect=[sys.argv[2]]), "test")
bus.subscribe("many", lambda sample: None)
bus.declare_alive("alive/reader")
print("up", flush=True)
time.sleep(100)
"""


@pytest.mark.slow
def test_a_session_closes_while_a_stopped_process_blocks_a_put(tmp_path):
    ours, other = (f"unixsock-stream/{tmp_path}/{name}" for name in "ab")
    bus = ZenohBus(Endpoint(listen=[ours], connect=[]), "test")
    put, up = bus.publisher("many", "text/plain"), threading.Event()
    bus.watch_alive("alive/reader", lambda _key, _alive: up.set())
    with subprocess.Popen([sys.executable, "-c", READER, other, ours]) as reader:
        try:
            assert up.wait(30.0)
            reader.send_signal(signal.SIGSTOP)
            blocked = threading.Thread(target=put_many, args=(put,), daemon=True)
            blocked.start()
            blocked.join(3.0)
            assert blocked.is_alive()
            began = time.monotonic()
            bus.close()
            assert time.monotonic() - began < 60.0
        finally:
            reader.kill()
    blocked.join(30.0)
    assert not blocked.is_alive()


def put_many(put):
    """Fill the buffers of the link."""
    with contextlib.suppress(zenoh.ZError):  # The session is closed.
        for _ in range(100_000):
            put(bytes(1000))
