"""The chain by hand: plant, controller and mission in processes, over pyzmq or Zenoh.

No orchestrator, no types, no recording. The mission runs ahead by up to a window, as it does in
stepbus. `python -m benchmarks.suite.peers.chain pyzmq|zenoh STEPS`.
"""

import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from queue import SimpleQueue
from typing import Any

from benchmarks.suite.clock import Clock

from stepbus_participant import Endpoint, ZenohBus

from .arm import Controller, Plant, reference

WINDOW = 64
CREDIT = WINDOW // 2
PARTICIPANTS = ("plant", "controller", "mission")


class ZenohWire:
    """The chain over Zenoh, on the same transport as stepbus.

    put: send to every listener. grant: advance the mission by half a window. get: the next message
    of a participant.
    """

    def __init__(self, name: str, hears: tuple[str, ...], folder: str) -> None:
        addresses = [f"unixsock-stream/{folder}/{participant}.sock" for participant in PARTICIPANTS]
        own = PARTICIPANTS.index(name)
        self._bus = ZenohBus(Endpoint(listen=[addresses[own]], connect=addresses[:own]), "chain")
        self._queues: dict[str, SimpleQueue[Any]] = {
            participant: SimpleQueue() for participant in hears
        }
        self._put = self._bus.publisher(f"out/{name}", "application/octet-stream")
        self._credit = self._bus.publisher("out/credit", "application/octet-stream")
        for participant, queue in self._queues.items():
            self._bus.subscribe_content(f"out/{participant}", queue.put)

    def put(self, data: bytes) -> None:
        self._put(data)

    def grant(self) -> None:
        self._credit(b"")

    def get(self, participant: str) -> bytes:
        data: bytes = self._queues[participant].get(timeout=10)
        return data

    def close(self) -> None:
        self._bus.close()


class ZmqWire:
    """The chain over pyzmq, one PUB socket each."""

    def __init__(self, name: str, hears: tuple[str, ...], folder: str) -> None:
        import zmq  # noqa: PLC0415

        context = zmq.Context()
        self._out = context.socket(zmq.PUB)
        self._out.setsockopt(zmq.SNDHWM, 0)
        self._out.bind(f"ipc://{folder}/{name}.zmq")
        self._credit = context.socket(zmq.PUB)
        if name == "plant":
            self._credit.bind(f"ipc://{folder}/credit.zmq")
        self._in = {}
        for participant in hears:
            socket = self._in[participant] = context.socket(zmq.SUB)
            socket.setsockopt(zmq.SUBSCRIBE, b"")
            socket.setsockopt(zmq.RCVTIMEO, 10_000)
            socket.connect(f"ipc://{folder}/{participant}.zmq")

    def put(self, data: bytes) -> None:
        self._out.send(data)

    def grant(self) -> None:
        self._credit.send(b"")

    def get(self, participant: str) -> bytes:
        data: bytes = self._in[participant].recv()
        return data

    def close(self) -> None:
        for socket in (self._out, self._credit, *self._in.values()):
            socket.close(0)


Wire = ZenohWire | ZmqWire
WIRES: dict[str, Callable[[str, tuple[str, ...], str], Wire]] = {
    "zenoh": ZenohWire,
    "pyzmq": ZmqWire,
}


Role = Callable[[Wire, int, Callable[[], None]], None]
"""What a process does with its wire, for so many steps; it calls the last one when it is ready."""
HEARS = {"plant": ("controller",), "controller": ("plant", "mission"), "mission": ("credit",)}


def plant(wire: Wire, steps: int, ready: Any) -> None:
    """Send the state, step under the command; every half window, let the mission advance."""
    arm = Plant()
    ready()
    clock = Clock()
    for step in range(steps):
        wire.put(arm.state())
        arm.step(wire.get("controller"))
        if step % CREDIT == CREDIT - 1:
            wire.grant()
        clock.tick()
    clock.show()


def controller(wire: Wire, steps: int, ready: Any) -> None:
    """Answer state and reference with torques."""
    law = Controller()
    ready()
    for _ in range(steps):
        state = wire.get("plant")
        wire.put(law.torque(state, wire.get("mission")))


def mission(wire: Wire, steps: int, ready: Any) -> None:
    """Send references, at most a window ahead."""
    ready()
    for step in range(steps):
        if step >= WINDOW and step % CREDIT == 0:
            wire.get("credit")
        wire.put(reference(step))


ROLES: dict[str, Role] = {"plant": plant, "controller": controller, "mission": mission}


def _take_part(role: Role, make_wire: Callable[[], Wire], steps: int, barrier: Any) -> None:
    wire = make_wire()
    time.sleep(1.0)  # every link is up within 0.5 s
    role(wire, steps, barrier.wait)
    barrier.wait()
    wire.close()
    sys.stdout.flush()
    os._exit(0)


def main(transport: str, steps: int) -> None:
    """Run one chain, a process for each role."""
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(len(PARTICIPANTS))
    with tempfile.TemporaryDirectory(prefix="chain-") as folder:
        children = []
        for name in PARTICIPANTS:
            make_wire = partial(WIRES[transport], name, HEARS[name], folder)
            arguments = (ROLES[name], make_wire, steps, barrier)
            children.append(context.Process(target=_take_part, args=arguments))
        for child in children:
            child.start()
        for child in children:
            child.join()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
