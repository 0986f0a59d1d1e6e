"""How far the physics engines agree: the table of docs/guide/running/agreement.md, from real runs.

    python -m benchmarks.agreement [--keep FOLDER]

Every case runs on PyBullet and on MuJoCo. The tolerances were written, and committed, before MuJoCo
was measured; that of a box that lies aslant, which came later, is that of the straight one. Exit
code 1: a difference is beyond its tolerance.
"""

import argparse
import math
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

import stepbus
from stepbus import JointState
from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_plant.engine import BASE
from stepbus_plant.engines import is_here
from stepbus_plant.geometry import product, quaternion, rotation
from stepbus_plant.world import EngineName
from stepbus_schemas import GripperCommand

Array = NDArray[np.float64]
ENGINES: tuple[EngineName, ...] = get_args(EngineName)
G, STEP_NS, STEP = 9.81, 1_000_000, 1e-3
_SLOPE, _MU = math.radians(35), 0.5

_BOX = """<robot name="{name}"><link name="{name}"><inertial><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry>{shape}</geometry></collision></link></robot>"""
_FLOOR = """<robot name="floor"><link name="floor"><collision><origin xyz="0 0 -0.5"/><geometry>
<box size="20 20 1"/></geometry></collision></link></robot>"""
_PADS = """<robot name="pads"><link name="rail"/>{pads}</robot>"""
_PAD = """<link name="{name}_pad"><inertial><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 {y} 0"/><geometry><box size="0.06 0.012 0.06"/></geometry></collision>
</link><joint name="{name}" type="prismatic"><parent link="rail"/><child link="{name}_pad"/>
<origin xyz="0 0 1"/><axis xyz="0 {sign} 0"/>
<limit lower="0" upper="0.1" effort="30" velocity="1"/></joint>"""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One thing that both engines do.

    quantity: what is compared, with its unit, which has a `tolerance`. measure: returns it for an
    engine, shape (n,); one folder for its files. expected: last value by the closed form; None: no
    single value of it says anything. needs: a package.
    """

    name: str
    quantity: str
    tolerance: float
    measure: Callable[[EngineName, Path], Array]
    expected: float | None = None
    needs: str = ""


def _world(engine: EngineName, folder: Path, text: str, **models: str) -> SimulatedPlant:
    """Return a plant of a world file; models: name → URDF."""
    for name, urdf in models.items():
        (folder / f"{name}.urdf").write_text(urdf)
    (folder / "world.yaml").write_text(text)
    params = Params.of({"world": "world.yaml", "engine": engine})
    return SimulatedPlant(load_world(folder / "world.yaml"), params, STEP_NS, 0)


def _advance(plant: SimulatedPlant, steps: int) -> Iterator[int]:
    for step in range(steps):
        plant.advance()
        yield step


def _height(plant: SimulatedPlant) -> float:
    """Return how high the second body is [m]."""
    return float(plant.physics.engine.centre(1)[0][2])


def _cube(mass: float, edge: float) -> str:
    shape, moment = f'<box size="{edge} {edge} {edge}"/>', mass * edge**2 / 6
    return _BOX.format(name="crate", mass=mass, i=moment, shape=shape)


def _dropped(engine: EngineName, folder: Path) -> SimulatedPlant:
    """Return a crate of 1 kg that begins to fall through 0.25 m."""
    text = (
        "bodies:\n  floor: {urdf: floor.urdf, fixed_base: true}\n"
        "  crate: {urdf: crate.urdf, position: [0, 0, 0.3]}\n"
    )
    return _world(engine, folder, text, floor=_FLOOR, crate=_cube(1.0, 0.1))


def falling(engine: EngineName, folder: Path) -> Array:
    """Return the heights during 0.2 s of free fall [m]."""
    plant = _dropped(engine, folder)
    return np.array([_height(plant) for _ in _advance(plant, 200)])


def landed(engine: EngineName, folder: Path) -> Array:
    """Return the height after 1 s [m]."""
    plant = _dropped(engine, folder)
    return np.array([_height(plant) for _ in _advance(plant, 1000)][-1:])


def weight(engine: EngineName, folder: Path) -> Array:
    """Return the force between the crate and the floor, the mean of 0.1 s after 1 s [N]."""
    plant = _dropped(engine, folder)
    forces = [
        sum(contact.force for contact in plant.physics.engine.contacts(1))
        for _ in _advance(plant, 1100)
    ]
    return np.array([np.mean(forces[1000:])])


def _downhill(
    engine: EngineName, folder: Path, urdf: str, above: float, mu: float, *, yaw: float = 0.0
) -> Array:
    """Return how far a body gets down a slope in 1 s [m]; yaw: about its normal [rad]."""
    half = _SLOPE / 2
    turn = rotation((0.0, math.sin(half), 0.0, math.cos(half)))
    x, _, z = (turn @ (0.0, 0.0, above)).tolist()
    rpy = f"orientation_rpy: [0, {_SLOPE}, 0]"
    there = f"position: [{x}, 0, {z}], {rpy}, friction: {{lateral: {mu}}}"
    # Of two frictions PyBullet takes the product, MuJoCo the larger one, or the one that is given.
    rough = ", friction: {lateral: 1}" if engine == "pybullet" else ""
    text = (
        "bodies:\n"
        f"  floor: {{urdf: floor.urdf, fixed_base: true, {rpy}{rough}}}\n"
        f"  thing: {{urdf: thing.urdf, {there}}}\n"
    )
    plant = _world(engine, folder, text, floor=_FLOOR, thing=urdf)
    place, lies = plant.physics.engine.frame((1, BASE))
    before = np.array(place)
    plant.physics.engine.put(1, (place, product(lies, quaternion((0.0, 0.0, yaw)))))
    for _ in _advance(plant, 1000):
        pass
    moved = np.array(plant.physics.engine.frame((1, BASE))[0]) - before
    return np.array([moved @ turn @ (1.0, 0.0, 0.0)])


_FLAT = _BOX.format(name="thing", mass=1, i=0.01, shape='<box size="0.2 0.2 0.05"/>')


def sliding(engine: EngineName, folder: Path, yaw: float = 0.0) -> Array:
    """Return how far a box of friction 0.5, turned by `yaw` [rad], slides [m]."""
    return _downhill(engine, folder, _FLAT, 0.025, _MU, yaw=yaw)


def rolling(engine: EngineName, folder: Path) -> Array:
    """Return how far a wheel gets that has the moment of a disc, and touches as a ball does [m]."""
    urdf = _BOX.format(name="thing", mass=1, i=0.5 * 0.1**2, shape='<sphere radius="0.1"/>')
    return _downhill(engine, folder, urdf, 0.1, 1.0)


def _grasp(engine: EngineName, folder: Path) -> tuple[Array, Array]:
    """Return heights of a held box [m], and the forces of the grip [N], in each step of 2 s."""
    pads = [("left", 1, 0.006), ("right", -1, -0.006)]
    urdf = _PADS.format(pads="".join(_PAD.format(name=n, sign=s, y=y) for n, s, y in pads))
    side = "{mode: velocity, position: 0.03}"
    text = (
        "grippers: {hand: {left: left, right: right}}\n"
        "bodies:\n  hand: {urdf: hand.urdf, fixed_base: true, friction: {lateral: 1}, "
        f"joints: {{left: {side}, right: {side}}}}}\n"
        "  crate: {urdf: crate.urdf, position: [0, 0, 1], friction: {lateral: 0.8}}\n"
    )
    plant = _world(engine, folder, text, hand=urdf, crate=_cube(0.2, 0.05))
    hand = plant.devices.grippers["hand"]
    driver = plant.devices.driver("hand", "GripperCommand/1", plant.motors)
    driver.apply(GripperCommand(width=0.0, force=15.0))
    rows = []
    driver.before_step()
    for _ in _advance(plant, 2000):
        driver.before_step()
        rows.append((_height(plant), hand.sense(0).force))
    heights, forces = np.array(rows).T
    return heights, forces


def held(engine: EngineName, folder: Path) -> Array:
    """Return how far the box sinks between 0.5 and 2 s [m]."""
    heights, _ = _grasp(engine, folder)
    return np.array([heights[500] - heights[-1]])


def squeezed(engine: EngineName, folder: Path) -> Array:
    """Return the force of the grip, the mean of the last 0.5 s [N]."""
    _, forces = _grasp(engine, folder)
    return np.array([np.mean(forces[1500:])])


def _tracked(scenario: str) -> Callable[[EngineName, Path], Array]:
    def measure(engine: EngineName, folder: Path) -> Array:
        """Return the positions of all joints in every step of a run [rad]."""
        out = folder / scenario
        result = stepbus.run(
            scenario, set={"plant.params.engine": engine}, out=out, in_process=True
        )
        if result.outcome != "finished":
            raise SystemExit(f"{scenario} with {engine}: {result.outcome}: {result.reason}")
        messages = stepbus.Recording(result.recording).messages("plant/joint_state")
        rows = [m.position for _, m in messages if isinstance(m, JointState) and m.position]
        return np.array(rows).ravel()

    return measure


_DOWN = G * math.sin(_SLOPE)
_SLIDES = _DOWN - _MU * G * math.cos(_SLOPE)


def _way(acceleration: float, steps: int) -> float:
    """Return the way from rest at an acceleration [m], as semi-implicit Euler has it."""
    return acceleration * STEP**2 * steps * (steps + 1) / 2


CASES = (
    Case(
        name="two_link, 10 s of tracking, no contact",
        quantity="position of the joints [rad]",
        tolerance=1e-9,
        measure=_tracked("two_link"),
    ),
    Case(
        name="baxter, 10 s of two arms with position drives",
        quantity="position of the joints [rad]",
        tolerance=2e-3,
        measure=_tracked("baxter"),
        needs="stepbus_store",
    ),
    Case(
        name="a box falls for 0.2 s",
        quantity="height [m]",
        tolerance=1e-9,
        expected=0.3 - _way(G, 200),
        measure=falling,
    ),
    Case(
        name="it lies on the floor",
        quantity="height [m]",
        tolerance=2e-3,
        expected=0.05,
        measure=landed,
    ),
    Case(
        name="it presses on the floor",
        quantity="force [N]",
        tolerance=0.1,
        expected=G,
        measure=weight,
    ),
    Case(
        name="a box slides down 35° for 1 s, friction 0.5",
        quantity="way [m]",
        tolerance=0.03 * _way(_SLIDES, 1000),
        expected=_way(_SLIDES, 1000),
        measure=sliding,
    ),
    Case(
        name="the same box, turned by 0.6 rad",
        quantity="way [m]",
        tolerance=0.03 * _way(_SLIDES, 1000),
        expected=_way(_SLIDES, 1000),
        measure=partial(sliding, yaw=0.6),
    ),
    Case(
        name="a wheel rolls down 35° for 1 s",
        quantity="way [m]",
        tolerance=0.02 * _way(_DOWN * 2 / 3, 1000),
        expected=_way(_DOWN * 2 / 3, 1000),
        measure=rolling,
    ),
    Case(
        name="two driven pads hold a box for 1.5 s",
        quantity="how far it sinks [m]",
        tolerance=2e-3,
        expected=0.0,
        measure=held,
    ),
    Case(
        name="they squeeze it with 15 N",
        quantity="force [N]",
        tolerance=0.3,
        expected=15.0,
        measure=squeezed,
    ),
)


def rows(folder: Path) -> Iterator[tuple[str, bool]]:
    """Yield a row of the table for each case, and whether its tolerance holds."""
    for number, case in enumerate(CASES):
        if case.needs and find_spec(case.needs) is None:
            print(f"skipped {case.name}: {case.needs} is not installed", file=sys.stderr)
            continue
        values = []
        for engine in ENGINES:
            place = folder / f"{number}-{engine}"
            place.mkdir(parents=True)
            values.append(case.measure(engine, place))
        difference = float(np.abs(values[0] - values[-1]).max())
        holds = difference <= case.tolerance
        shown = ["" if case.expected is None else f"{value[-1]:.6g}" for value in values]
        expected = "" if case.expected is None else f"{case.expected:.6g}"
        cells = [case.name, case.quantity, f"{case.tolerance:.2g}", expected, *shown]
        cells += [f"{difference:.2g}", "yes" if holds else "**no**"]
        yield f"| {' | '.join(cells)} |", holds


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, help="new folder for the recordings")
    args = parser.parse_args()
    missing = [name for name in ENGINES if not is_here(name)]
    if missing:
        raise SystemExit(f"{missing[0]} is not installed; this benchmark compares both engines")
    print(f"| Case | What | Tolerance | Closed form | {' | '.join(ENGINES)} | Difference | Holds |")
    print("|---|---|---|---|---|---|---|---|")
    all_hold = True
    with tempfile.TemporaryDirectory(prefix="agreement-") as name:
        for row, holds in rows(args.keep or Path(name)):
            print(row, flush=True)
            all_hold &= holds
    return 0 if all_hold else 1


if __name__ == "__main__":
    sys.exit(main())
