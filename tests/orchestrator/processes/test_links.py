"""A link to somebody else's process is cut, and a put that it blocks returns."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading

import msgspec
import pytest
from support.runs.kernel import scenario
from support.surroundings import no_borrowed_descriptors

from stepbus_orchestrator.processes.attached import cut_links
from stepbus_orchestrator.processes.endpoints import make_mesh, private_folder
from stepbus_orchestrator.scenario.model import BusSpec
from stepbus_participant import Endpoint, ZenohBus

SIZE = 10_000
FROZEN = """
import json, os, signal, sys
import msgspec
from stepbus_participant import Endpoint, ZenohBus
endpoint = msgspec.json.decode(sys.argv[1], type=Endpoint)
bus = ZenohBus(endpoint, "r")
bus.subscribe("trigger", lambda sample: os.kill(os.getpid(), signal.SIGSTOP))
bus.declare_alive("alive/controller")
sys.stdin.read()
"""


@pytest.fixture
def held():
    with contextlib.ExitStack() as stack:
        yield stack


@pytest.mark.parametrize("transport", ["unix", "tcp"])
@pytest.mark.parametrize("is_known", [True, False])
def test_a_put_to_a_frozen_process_returns_when_its_link_is_cut(
    own_temp, held, transport, is_known
):
    folder = private_folder()
    mesh = make_mesh(scenario(bus=BusSpec(transport=transport)), folder, "r", held)
    endpoint = json.dumps(msgspec.to_builtins(mesh.participants["controller"]))
    bus = ZenohBus(mesh.orchestrator, "r")
    alive = threading.Event()
    bus.watch_alive("alive/*", lambda _key, is_alive: alive.set() if is_alive else None)
    process = subprocess.Popen([sys.executable, "-c", FROZEN, endpoint], stdin=subprocess.PIPE)
    put = bus.publisher("trigger", "application/octet-stream")

    is_stopped = threading.Event()

    def flood():
        while not is_stopped.is_set():
            put(bytes(SIZE))
        # No buffer holds that much.
        for _ in range(100_000_000 // SIZE):
            put(bytes(SIZE))

    flooding = threading.Thread(target=flood)
    try:
        assert alive.wait(60)
        flooding.start()
        os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT)
        is_stopped.set()
        assert flooding.is_alive()
        cut_links(mesh.orchestrator.listen[0], process.pid if is_known else 0, [os.getpid()])
        flooding.join(60)
        assert not flooding.is_alive()
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate()
        is_stopped.set()
        flooding.join()
        bus.close()
        shutil.rmtree(folder)


def test_links_of_children_are_left(own_temp, held):
    folder = private_folder()
    mesh = make_mesh(scenario(), folder, "r", held)
    bus = ZenohBus(mesh.orchestrator, "r")
    endpoint = mesh.participants["controller"]
    got = threading.Event()
    bus.subscribe("out/controller", lambda _sample: got.set())
    other = ZenohBus(Endpoint(**{**msgspec.structs.asdict(endpoint), "listen": []}), "r")
    try:
        # It is a process of this session, as if a child had opened it.
        with no_borrowed_descriptors():
            cut_links(mesh.orchestrator.listen[0], 0, [os.getsid(0)])
        put = other.publisher("out/controller", "application/octet-stream")
        for _ in range(600):
            put(b"x")
            if got.wait(0.1):
                break
        assert got.is_set()
    finally:
        other.close()
        bus.close()
        shutil.rmtree(folder)
