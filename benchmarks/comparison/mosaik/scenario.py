# mypy: ignore-errors
"""The mosaik scenario: plant and controller, each a process of its own."""

import sys
from pathlib import Path

import arm
import mosaik

HERE = Path(__file__).parent


def main() -> None:
    """Run it."""
    python = f"{sys.executable} {HERE}"
    world = mosaik.World(
        {
            "Plant": {"cmd": f"{python}/plant.py %(addr)s"},
            "Controller": {"cmd": f"{python}/controller.py %(addr)s"},
            "Collector": {"python": "collector:Collector"},
        }
    )
    plant = world.start("Plant").Arm()
    controller = world.start("Controller").PD()
    collector = world.start("Collector").Collector()
    world.connect(plant, controller, "position", "velocity")
    world.connect(
        controller, plant, "torque", time_shifted=True, initial_data={"torque": [0.0, 0.0]}
    )
    world.connect(plant, collector, "position", "velocity")
    world.connect(controller, collector, "torque")
    # Step k of the plant applies the torque of step k - 1, so the last one takes one step more.
    world.run(until=arm.STEPS + 1, print_progress=False)


if __name__ == "__main__":
    main()
