"""One plain loop in one process: what the work takes without any coupling."""

import sys

from benchmarks.suite.clock import Clock

from .arm import Controller, MujocoPlant, Plant, reference


def main(engine: str, steps: int) -> None:
    """Run it. engine: pybullet or mujoco."""
    plant = MujocoPlant() if engine == "mujoco" else Plant()
    controller, clock = Controller(), Clock()
    for step in range(steps):
        plant.step(controller.torque(plant.state(), reference(step)))
        clock.tick()
    clock.show()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
