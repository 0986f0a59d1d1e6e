"""Physics engines side by side: steps/s of the plant, and its start-up.

    python -m benchmarks.engines [--rounds 5] [--share 1] [--only two_link]

Each round runs every case on each engine in turn, in this process and without an orchestrator. What
counts is the ratio in each round: by the wall clock, and by the time of the processor, which other
programs disturb less. Start-up is the time from the import of the engine's module to the end of the
first step, of a fresh process each.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import get_args

from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_plant.engines import is_here
from stepbus_plant.world import EngineName

ENGINES: tuple[EngineName, ...] = get_args(EngineName)
_BOX = """<robot name="{name}"><link name="{name}"><inertial><mass value="1"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 {z}"/><geometry><box size="{size}"/></geometry></collision>
</link></robot>"""
_MS = 1_000_000


@dataclass(frozen=True, kw_only=True)
class Case:
    """A world, in a package or made here; seconds: of simulation in a round. step_ns: [ns]."""

    name: str
    package: str
    world: str
    step_ns: int
    seconds: float

    def path(self, folder: Path) -> Path:
        """Return the world file; folder: of those that are made here."""
        if not self.package:
            return _write_boxes(folder)
        return Path(str(files(self.package))) / self.world


CASES = (
    Case(
        name="two_link",
        package="stepbus_scenarios",
        world="two_link/world.yaml",
        step_ns=5 * _MS,
        seconds=20.0,
    ),
    Case(
        name="baxter",
        package="stepbus_store",
        world="scenarios/baxter/world.yaml",
        step_ns=50 * _MS,
        seconds=20.0,
    ),
    Case(name="20 boxes", package="", world="", step_ns=_MS, seconds=2.0),
)


def _write_boxes(folder: Path) -> Path:
    """Write a world of 20 boxes of 0.1 m that fall on a floor, and on each other."""
    (folder / "box.urdf").write_text(_BOX.format(name="box", i=1 / 600, z=0, size="0.1 0.1 0.1"))
    (folder / "floor.urdf").write_text(_BOX.format(name="floor", i=1, z=-0.5, size="20 20 1"))
    rows = ["  floor: {urdf: floor.urdf, fixed_base: true}"]
    for n in range(20):
        x, y, z = 0.13 * (n % 3), 0.13 * (n // 3 % 3), 0.1 + 0.15 * (n // 9) + 0.01 * (n % 2)
        rows.append(f"  box{n}: {{urdf: box.urdf, position: [{x:g}, {y:g}, {z:g}]}}")
    world = folder / "boxes.yaml"
    world.write_text("\n".join(["bodies:", *rows, ""]))
    return world


def make(engine: EngineName, world: Path, step_ns: int) -> SimulatedPlant:
    """Return a plant of a world file."""
    params = Params.of({"world": str(world), "engine": engine})
    return SimulatedPlant(load_world(world), params, step_ns, 0)


def speed(engine: EngineName, world: Path, case: Case, share: float) -> tuple[float, float]:
    """Return steps/s by the wall clock and by the processor's; share: of the case's length."""
    plant = make(engine, world, case.step_ns)
    plant.advance()
    steps = max(1, round(share * case.seconds * 1e9 / case.step_ns))
    wall, processor = time.perf_counter(), time.process_time()
    for _ in range(steps):
        plant.advance()
        plant.sense()
    speeds = steps / (time.perf_counter() - wall), steps / (time.process_time() - processor)
    plant.close()
    return speeds


def start_up(engine: EngineName, world: Path, case: Case) -> float:
    """Return the time from the import to the end of the first step, in a fresh process [s]."""
    words = [sys.executable, "-m", "benchmarks.engines", "--first-step", engine, str(world)]
    done = subprocess.run([*words, str(case.step_ns)], check=True, capture_output=True, text=True)
    return float(done.stdout.split()[-1])


def first_step(engine: EngineName, world: str, step_ns: str) -> None:
    """Print how long the first step takes from here on [s]."""
    began = time.perf_counter()
    import_module(f"stepbus_plant.engines.{engine}")
    make(engine, Path(world), int(step_ns)).advance()
    print(time.perf_counter() - began)


def _cases(only: str, folder: Path) -> Iterator[tuple[Case, Path]]:
    for case in CASES:
        if only and case.name != only:
            continue
        if case.package and find_spec(case.package) is None:
            print(f"skipped {case.name}: {case.package} is not installed", file=sys.stderr)
            continue
        yield case, case.path(folder)


def compare(case: Case, world: Path, rounds: int, share: float) -> None:
    """Print the figures of each round, and the median ratios of the second engine to the first."""
    ratios = []
    one, other = ENGINES
    for number in range(rounds):
        order = ENGINES if number % 2 == 0 else ENGINES[::-1]
        speeds = {engine: speed(engine, world, case, share) for engine in order}
        starts = {engine: start_up(engine, world, case) for engine in order}
        row = [speeds[other][n] / speeds[one][n] for n in (0, 1)]
        ratios.append([*row, starts[other] / starts[one]])
        figures = ", ".join(
            f"{engine} {speeds[engine][0]:.0f} steps/s, start-up {starts[engine]:.2f} s"
            for engine in ENGINES
        )
        print(f"{case.name}, round {number}: {figures}; ratio {row[0]:.2f}", flush=True)
    wall, processor, start = map(statistics.median, zip(*ratios, strict=True))
    print(
        f"{case.name}: {other} makes {wall:.2f} times the steps/s of {one} "
        f"({processor:.2f} by processor time), and takes {start:.2f} times as long to start"
    )


def main() -> None:
    """Measure, or, in a process of its own, make the first step."""
    if sys.argv[1:2] == ["--first-step"]:
        engine, *rest = sys.argv[2:]
        first_step(next(name for name in ENGINES if name == engine), *rest)
        return
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--share", type=float, default=1.0, help="fraction of each round to run; less is faster"
    )
    parser.add_argument("--only", default="", choices=[case.name for case in CASES])
    args = parser.parse_args()
    missing = [name for name in ENGINES if not is_here(name)]
    if missing:
        raise SystemExit(f"{missing[0]} is not installed; this benchmark compares both engines")
    with tempfile.TemporaryDirectory(prefix="engines-") as folder:
        for case, world in _cases(args.only, Path(folder)):
            compare(case, world, args.rounds, args.share)


if __name__ == "__main__":
    main()
