"""The chain by hand: plant, controller and mission in processes, over pyzmq or Zenoh.

No orchestrator, no types, no recording. The mission runs ahead by up to a window.
`python -m benchmarks.suite.peers.chain pyzmq|zenoh STEPS`.
"""

import multiprocessing
import os
import sys
import tempfile
import time
from typing import Any

from benchmarks.bare import CREDIT, PARTICIPANTS, WINDOW, WIRES, Wire

from .arm import Clock, Controller, Plant, reference

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


ROLES = {"plant": plant, "controller": controller, "mission": mission}


def _take_part(transport: str, name: str, steps: int, folder: str, barrier: Any) -> None:
    wire = WIRES[transport](name, HEARS[name], folder)
    time.sleep(1.0)  # every link is up within 0.5 s
    ROLES[name](wire, steps, barrier.wait)
    barrier.wait()
    wire.close()
    sys.stdout.flush()
    os._exit(0)


def main(transport: str, steps: int) -> None:
    """Run one chain."""
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(len(PARTICIPANTS))
    with tempfile.TemporaryDirectory(prefix="chain-") as folder:
        children = [
            context.Process(target=_take_part, args=(transport, name, steps, folder, barrier))
            for name in PARTICIPANTS
        ]
        for child in children:
            child.start()
        for child in children:
            child.join()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
