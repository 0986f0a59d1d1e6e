"""One plain loop in one process: what the work takes without any coupling."""

import sys

from benchmarks.suite.clock import Clock

from .arm import Controller, Plant, reference


def main(steps: int) -> None:
    """Run it."""
    plant, controller, clock = Plant(), Controller(), Clock()
    for step in range(steps):
        plant.step(controller.torque(plant.state(), reference(step)))
        clock.tick()
    clock.show()


if __name__ == "__main__":
    main(int(sys.argv[1]))
