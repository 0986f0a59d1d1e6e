"""A plant by itself, in one of the engines.

`python -m benchmarks.suite.engine_case WORLD ENGINE STEPS`, WORLD: two_link, baxter or boxes.
Prints also `start_s`, from the import of the engine's module to the end of the first step [s].
"""

import sys
import tempfile
import time
from importlib import import_module
from importlib.resources import files
from pathlib import Path

from stepbus_plant import Params, SimulatedPlant, load_world

from .clock import Clock

_MS = 1_000_000
_BOX = """<robot name="box"><link name="box"><inertial><mass value="1"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="{size}"/></geometry></collision></link></robot>"""


def write_boxes(folder: Path) -> Path:
    """Write a world of 20 boxes of 0.1 m that fall on a floor, and on each other."""
    (folder / "box.urdf").write_text(_BOX.format(i=1 / 600, size="0.1 0.1 0.1"))
    (folder / "floor.urdf").write_text(_BOX.format(i=1, size="20 20 1"))
    rows = ["  floor: {urdf: floor.urdf, fixed_base: true, position: [0, 0, -0.5]}"]
    for n in range(20):
        x, y, z = 0.13 * (n % 3), 0.13 * (n // 3 % 3), 0.1 + 0.15 * (n // 9) + 0.01 * (n % 2)
        rows.append(f"  box{n}: {{urdf: box.urdf, position: [{x:g}, {y:g}, {z:g}]}}")
    world = folder / "boxes.yaml"
    world.write_text("\n".join(["bodies:", *rows, ""]))
    return world


def world_of(name: str, folder: Path) -> tuple[Path, int]:
    """Return the file of a world, and its step [ns]; folder: for one that is made here."""
    match name:
        case "two_link":
            return Path(str(files("stepbus_scenarios"))) / "two_link/world.yaml", 5 * _MS
        case "baxter":
            return Path(str(files("stepbus_store"))) / "scenarios/baxter/world.yaml", 50 * _MS
        case _:
            return write_boxes(folder), _MS


def main(name: str, engine: str, steps: int) -> None:
    """Advance a plant."""
    with tempfile.TemporaryDirectory(prefix="engine-") as folder:
        world, step_ns = world_of(name, Path(folder))
        began = time.perf_counter()
        import_module(f"stepbus_plant.engines.{engine}")
        params = Params.of({"world": str(world), "engine": engine})
        plant = SimulatedPlant(load_world(world), params, step_ns, 0)
        plant.advance()
        start_s = time.perf_counter() - began
        clock = Clock()
        for _ in range(steps):
            plant.advance()
            plant.sense()
            clock.tick()
        clock.show(start_s=start_s)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
