"""Small worlds for the tests of the plant."""

import hashlib
from importlib import resources
from pathlib import Path

import numpy as np

from stepbus_plant import Params, SimulatedPlant, load_world
from stepbus_schemas import JointCommand

TWO_LINK = resources.files("stepbus_scenarios") / "two_link" / "two_link.urdf"
MS = 1_000_000

WHEEL = """<robot name="wheel">
<link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="disc"><inertial><mass value="1"/>
<inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axle" type="{type}"><parent link="base"/><child link="disc"/><axis xyz="0 0 1"/>
{limit}</joint></robot>"""
LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="3"/>'
"""A disc of 0.5 kg·m² on a vertical axle: gravity does nothing to it."""


def write_world(folder: Path, text: str) -> Path:
    """Write a world file beside two_link.urdf, wheel.urdf and free_wheel.urdf."""
    (folder / "two_link.urdf").write_text(TWO_LINK.read_text(encoding="utf-8"), encoding="utf-8")
    for name, kind, limit in (("wheel", "revolute", LIMIT), ("free_wheel", "continuous", "")):
        content = WHEEL.format(type=kind, limit=limit)
        (folder / f"{name}.urdf").write_text(content, encoding="utf-8")
    path = folder / "world.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def body(name: str, urdf: str, settings: str = "{}", joints: str = "{}") -> str:
    """Return one fixed body of a world file."""
    return (
        f"  {name}: {{urdf: {urdf}.urdf, fixed_base: true, "
        f"joint_defaults: {settings}, joints: {joints}}}\n"
    )


def make_plant(
    folder: Path, *bodies: str, world: str = "", step_ns: int = 5 * MS, seed: int = 0, **params
) -> SimulatedPlant:
    """Return a plant of some bodies; by default of the two-link arm."""
    rows = "".join(bodies or [body("arm", "two_link")])
    path = write_world(folder, f"{world}\nbodies:\n{rows}")
    return SimulatedPlant(
        load_world(path), Params.of({"world": path.name, **params}), step_ns, seed
    )


def drive(plant: SimulatedPlant, command: JointCommand, steps: int) -> np.ndarray:
    """Return position, velocity, effort after each step under one command: (steps, 3, n)."""
    plant.commander("command", plant.names).apply(command)
    rows = []
    for _ in range(steps):
        plant.advance()
        state = plant.sense()
        rows.append([state.position, state.velocity, state.effort])
    return np.array(rows)


def torques(step: int) -> list[float]:
    """Return torques that move the two-link arm about without end [N·m]."""
    return [15.0 * np.cos(0.01 * step) - 5.0, 4.0 * np.sin(0.017 * step)]


def swing(
    plant: SimulatedPlant, steps: int, names: tuple[str, ...] = ("joint1", "joint2")
) -> np.ndarray:
    """Return positions, velocities, efforts of the two-link arm under varying torques."""
    commander = plant.commander("command", names)
    rows = []
    for step in range(steps):
        values = dict(zip(("joint1", "joint2"), torques(step), strict=True))
        commander.apply(JointCommand(mode="torque", values=[values[n] for n in names]))
        plant.advance()
        state = plant.sense()
        rows.append([state.position, state.velocity, state.effort])
    return np.array(rows)


def digest(states: np.ndarray) -> str:
    """Return the hash of the exact bits of states."""
    return hashlib.sha256(states.tobytes()).hexdigest()
