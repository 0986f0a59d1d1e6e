"""The chain by hand: plant, controller and mission in processes, over pyzmq or Zenoh.

No orchestrator, no types, no recording. The mission runs ahead by up to a window.
`python -m benchmarks.suite.peers.chain pyzmq|zenoh STEPS`.
"""

import sys
from typing import Any

from benchmarks import bare
from benchmarks.bare import CREDIT, WINDOW, Role, Wire

from .arm import Clock, Controller, Plant, reference


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


if __name__ == "__main__":
    bare.main(sys.argv[1], int(sys.argv[2]), ROLES)
