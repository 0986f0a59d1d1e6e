"""Checkpoints of the plant, for worlds whose state PyBullet gives and takes to the bit.

PyBullet's own snapshots (`saveState`, `saveBullet`) live in its process, or leave out what its
solver keeps of contacts from one substep to the next. But a body with a fixed base that touches
nothing is no more than the positions and velocities of its joints, which `getJointState` and
`resetJointState` carry as doubles; the solver remembers nothing of motors, gears and stops. So
worlds of such bodies are saved, at steps without contact.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import pybullet as bullet

from stepbus_plant.drives import Drive
from stepbus_plant.engine import Physics
from stepbus_plant.sensing import Sensors, Warnings
from stepbus_plant.world_file import World

from .params import Params

_DEVICES = (
    "bases",
    "cameras",
    "contacts",
    "grippers",
    "imus",
    "lidars",
    "transforms",
    "wrenches",
)
"""Sections of a world that have a state of their own."""


class Saved(msgspec.Struct):
    """The state of a plant. joints: positions and velocities, in the engine's order [rad, rad/s].

    efforts: torques of the last step, of the sensed joints [N·m]. owners: joint → the input that
    drives it. reported, pending: of the warnings.
    """

    t_ns: int
    joints: list[tuple[float, float]]
    efforts: list[float]
    drives: list[dict[str, Any]]
    random: list[tuple[str, str]]
    owners: dict[str, str]
    reported: list[tuple[str, str]]
    pending: list[str]


def can_save(world: World, params: Params, physics: Physics) -> bool:
    """Return whether the state of a world can be had to the bit, now."""
    is_simple = (
        params.dynamics == "on"
        and not params.script
        and not any(getattr(world, section) for section in _DEVICES)
        and all(body.fixed_base for body in world.bodies.values())
    )
    return is_simple and not bullet.getContactPoints(physicsClientId=physics.client)


def _state(physics: Physics, joint: Any) -> tuple[float, float]:
    state = physics.read(joint.body, [joint.index])[0]
    return state[0], state[1]


def pack(
    *,
    t_ns: int,
    physics: Physics,
    efforts: list[float],
    drives: Sequence[Drive],
    sensors: Sensors,
    owners: Mapping[str, str],
    warnings: Warnings,
) -> bytes:
    """Return the state of a plant."""
    saved = Saved(
        t_ns=t_ns,
        joints=[_state(physics, joint) for joint in physics.joints],
        efforts=efforts,
        drives=[drive.save() for drive in drives],
        random=sensors.save(),
        owners=dict(owners),
        reported=sorted(warnings.reported),
        pending=warnings.pending,
    )
    return msgspec.msgpack.encode(saved)


def unpack(
    state: bytes, physics: Physics, drives: Sequence[Drive], sensors: Sensors, warnings: Warnings
) -> Saved:
    """Put the parts of a plant into a state, and return the rest of it."""
    saved = msgspec.msgpack.decode(state, type=Saved, strict=True)
    for joint, (position, velocity) in zip(physics.joints, saved.joints, strict=True):
        bullet.resetJointState(
            joint.body, joint.index, position, velocity, physicsClientId=physics.client
        )
    for drive, targets in zip(drives, saved.drives, strict=True):
        drive.restore(targets)
    sensors.restore(saved.random)
    warnings.reported, warnings.pending = set(saved.reported), saved.pending
    return saved
