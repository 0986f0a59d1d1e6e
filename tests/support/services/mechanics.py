"""Small solids of known inertia, and plants of them in an engine."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_plant.engine import BASE, Contact
from stepbus_plant.geometry import rotation
from stepbus_schemas import JointCommand

G = 9.81
MS = 1_000_000
STEP = 1e-3
"""Length of a physics substep, and of the plant's step, unless a test says otherwise [s]."""


Inertia = tuple[float, float, float]


def box_inertia(mass: float, size: Iterable[float]) -> Inertia:
    """Return the moments of a solid box [kg·m²]."""
    x, y, z = (edge * edge for edge in size)
    return mass * (y + z) / 12, mass * (x + z) / 12, mass * (x + y) / 12


def link(
    name: str, mass: float, inertia: Inertia, shape: str = "", centre: str = "0 0 0", more: str = ""
) -> str:
    """Return a link; shape: of collisions, in the middle of its mass at `centre`."""
    ixx, iyy, izz = inertia
    solid = f'<collision><origin xyz="{centre}"/><geometry>{shape}</geometry></collision>'
    return (
        f'<link name="{name}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
        f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f"{solid if shape else ''}{more}</link>"
    )


def joint(
    name: str,
    kind: str,
    child: str,
    axis: str = "0 1 0",
    limit: str = "",
    *,
    parent: str = "root",
    origin: str = 'xyz="0 0 0"',
    more: str = "",
) -> str:
    """Return a joint; limit, origin: attributes of these."""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin {origin}/><axis xyz="{axis}"/><limit {limit or HUGE}/>{more}</joint>'
    )


HUGE = 'effort="1e6" velocity="1e3"'
ROOT = link("root", 1.0, (1.0, 1.0, 1.0))


def robot(*parts: str) -> str:
    """Return a URDF."""
    return f'<robot name="robot">{"".join(parts)}</robot>'


def box(name: str, mass: float, *size: float, centre: str = "0 0 0") -> str:
    """Return the URDF of a box; size: [m]."""
    shape = f'<box size="{" ".join(map(str, size))}"/>'
    return robot(link(name, mass, box_inertia(mass, size), shape, centre))


def ball(name: str, mass: float, radius: float, share: float = 0.4) -> str:
    """Return the URDF of a ball; share: its moment over mass · radius² [-]."""
    moment = share * mass * radius**2
    return robot(link(name, mass, (moment,) * 3, f'<sphere radius="{radius}"/>'))


FLOOR = box("ground", 1.0, 20, 20, 1, centre="0 0 -0.5")
"""Its top is at z = 0."""

ROD = robot(
    ROOT,
    link("rod", 1.0, (1e-4, 1 / 12, 1 / 12), centre="0.5 0 0"),
    joint("hinge", "continuous", "rod"),
)
"""1 kg and 1 m, horizontal at 0, about whose end it turns down by positive angles."""
ROD_MOMENT = 1 / 3
ROD_TORQUE = 1.0 * G * 0.5
"""Of its weight when it is horizontal [N·m]."""

DISC = robot(ROOT, link("disc", 1.0, (0.5,) * 3), joint("axle", "continuous", "disc", "0 0 1"))
"""0.5 kg·m² on a vertical axle: gravity does nothing to it."""
DISC_MOMENT = 0.5


class Row(NamedTuple):
    """A body of a world: its model, and its other keys in the world file."""

    urdf: str
    keys: str = ""


def fixed(urdf: str, keys: str = "") -> Row:
    """Return a body that is fixed to the world."""
    return Row(urdf, f"fixed_base: true, {keys}")


def make(
    folder: Path,
    engine: str,
    bodies: dict[str, Row],
    world: str = "",
    step_ns: int = MS,
    **params: object,
) -> SimulatedPlant:
    """Return a plant of some bodies in an engine."""
    rows = []
    for name, row in bodies.items():
        (folder / f"{name}.urdf").write_text(row.urdf)
        rows.append(f"  {name}: {{urdf: {name}.urdf, {row.keys}}}\n")
    path = folder / "world.yaml"
    path.write_text(f"{world}\nbodies:\n{''.join(rows)}")
    given = Params.of({"world": path.name, "engine": engine, **params})
    return SimulatedPlant(load_world(path), given, step_ns, 0)


def advance(plant: SimulatedPlant, steps: int) -> SimulatedPlant:
    """Advance a plant by some steps, and return it."""
    for _ in range(steps):
        plant.advance()
    return plant


def command(plant: SimulatedPlant, mode: str, *values: float) -> None:
    """Command the joints of a plant from now on."""
    commander = plant.commander("command", plant.names)
    commander.apply(JointCommand(mode=mode, values=list(values)))


def state(plant: SimulatedPlant, name: str) -> tuple[float, float]:
    """Return position and velocity of a joint [rad, rad/s]."""
    return plant.physics.state(plant.physics.joints[name])


def sensed(plant: SimulatedPlant, port_type: str) -> object:
    """Return the sensor behind an output of a type."""
    return plant.devices.sensor("port", port_type)[0]


def number(plant: SimulatedPlant, name: str) -> int:
    """Return the number of a body."""
    return plant.physics.bodies.index(name)


def centre(plant: SimulatedPlant, name: str) -> np.ndarray:
    """Return where the centre of mass of a body's root is, shape (3,) [m]."""
    return np.array(plant.physics.engine.centre(number(plant, name))[0])


def velocity(plant: SimulatedPlant, name: str) -> np.ndarray:
    """Return the velocity of that, shape (3,) [m/s]."""
    return np.array(plant.physics.engine.motion((number(plant, name), BASE)).velocity)


def between(plant: SimulatedPlant, one: str, other: str) -> list[Contact]:
    """Return the contacts of two bodies, as the first one has them."""
    contacts = plant.physics.engine.contacts(number(plant, one))
    return [contact for contact in contacts if contact.other[0] == number(plant, other)]


def rough(engine: str) -> str:
    """Return the keys of a floor on which the friction of other bodies is that of the contact.

    PyBullet takes the product; MuJoCo the one that is given, and of two the larger.
    """
    return "friction: {lateral: 1.0}" if engine == "pybullet" else ""


def slope(engine: str, angle: float, friction: float, height: float) -> tuple[str, np.ndarray, str]:
    """Return the keys of a floor that falls along x, the direction down, and those of what lies on it.

    angle: [rad]. friction: of what lies on it. height: of its centre above the slope [m].
    """
    turned = f"orientation_rpy: [0, {angle}, 0]"
    down = rotation((0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)))
    place = ", ".join(map(str, (down @ (0.0, 0.0, height)).tolist()))
    thing = f"position: [{place}], {turned}, friction: {{lateral: {friction}}}"
    return f"{turned}, {rough(engine)}", down @ (1.0, 0.0, 0.0), thing


def acceleration(
    plant: SimulatedPlant, name: str, direction: np.ndarray, begin: int, end: int
) -> float:
    """Return the mean acceleration of a body along a direction from one step to another [m/s²]."""
    before = velocity(advance(plant, begin), name) @ direction
    return float(velocity(advance(plant, end - begin), name) @ direction - before) / (
        (end - begin) * STEP
    )
