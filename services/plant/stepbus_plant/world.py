"""What a world file may say, as frozen types, and how it is read.

Relative file names are relative to the world file. Lengths [m], angles [rad], torques [N·m]; for
prismatic joints read [m] and [N] where an angle and a torque are named.
"""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from stepbus.config import package_path
from stepbus_schemas import WiringError
from stepbus_schemas.messages import JointMode

from .checked import Finite, NonNegative, Problem, Source, Vector3, Where, find_problems

Actuation = Literal["direct", "velocity_force"]

_UNITS_NS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}
_DURATION = r"^[0-9]+(\.[0-9]+)? *(ns|us|ms|s)$"
Duration = Annotated[str, msgspec.Meta(pattern=_DURATION)]


class _Row(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A mapping of the world file."""


class JointSettings(_Row, frozen=True):
    """What the world says about a joint, over what its URDF says; absent: the URDF holds."""

    mode: JointMode | None = None
    """What commands mean to it: the only mode it takes. Default: torque."""
    actuation: Actuation | None = None
    """How mode torque is carried out. Default: the plant's `actuation`, or direct."""
    position: Finite | None = None
    """At the start [rad]. Default: the place nearest to 0 within the limits."""
    velocity: Finite | None = None
    """At the start [rad/s]. Default: 0."""
    lower: Finite | None = None
    """Stop of the joint [rad]."""
    upper: Finite | None = None
    """Stop of the joint [rad]."""
    effort: NonNegative | None = None
    """Largest torque of its motor [N·m]; commands saturate at it."""
    max_velocity: NonNegative | None = None
    """Largest velocity of modes velocity and position [rad/s]; commands saturate at it."""
    damping: NonNegative | None = None
    """Viscous friction [N·m·s/rad]. Default: 0, whatever the URDF says."""
    friction: NonNegative | None = None
    """Coulomb friction [N·m], of mode torque with direct actuation. Default: 0, likewise."""

    def over(self, defaults: JointSettings) -> JointSettings:
        """Return these settings, with those of `defaults` where they are absent."""
        said = {k: v for k, v in msgspec.structs.asdict(self).items() if v is not None}
        return msgspec.structs.replace(defaults, **said)


class Friction(_Row, frozen=True):
    """Contact friction of all links of a body [-]; absent: PyBullet's or the URDF's."""

    lateral: NonNegative | None = None
    rolling: NonNegative | None = None
    spinning: NonNegative | None = None


class Body(_Row, frozen=True):
    """A body, read from a URDF."""

    urdf: str
    """Beside the world file, absolute, or `package://<package>/<path>`."""
    position: Vector3 = (0.0, 0.0, 0.0)
    """Position of the base in the world [m]."""
    orientation_rpy: Vector3 = (0.0, 0.0, 0.0)
    """Orientation of the base in the world: roll, pitch, yaw about fixed axes [rad]."""
    fixed_base: bool = False
    friction: Friction = Friction()
    joint_defaults: JointSettings = JointSettings()
    """Holds for every joint of the body."""
    joints: dict[str, JointSettings] = {}
    """Joint of the URDF → settings over `joint_defaults`."""


class World(_Row, frozen=True):
    """Everything that is simulated."""

    bodies: dict[str, Body]
    gravity: Vector3 = (0.0, 0.0, -9.81)
    """[m/s²]"""
    physics_step: Duration | None = None
    """Length of a physics substep, e.g. `1ms`; has to divide the communication step exactly."""
    substeps: Annotated[int, msgspec.Meta(ge=1)] | None = None
    """Physics substeps per communication step, instead of `physics_step`. Default: 1."""
    solver_iterations: Annotated[int, msgspec.Meta(ge=1)] = 50

    def physics_ns(self, period_ns: int) -> int:
        """Return the length of a physics substep [ns].

        period_ns: length of a communication step [ns]. Raises WiringError when the substep does
        not divide it exactly.
        """
        if self.physics_step is None:
            step_ns, rest = divmod(period_ns, self.substeps or 1)
            if rest:
                raise WiringError(
                    f"substeps: {self.substeps} substeps do not divide the communication step of "
                    f"{period_ns} ns into whole nanoseconds"
                )
            return step_ns
        step_ns = duration_ns(self.physics_step)
        if period_ns % step_ns:
            raise WiringError(
                f"physics_step: {self.physics_step} ({step_ns} ns) does not divide the "
                f"communication step of {period_ns} ns exactly"
            )
        return step_ns


def duration_ns(text: str) -> int:
    """Return a duration such as `5ms` [ns].

    Raises WiringError when that is not a positive whole number.
    """
    unit = text.lstrip("0123456789. ")
    value = Decimal(text.removesuffix(unit).strip()) * _UNITS_NS[unit]
    if value != int(value) or value < 1:
        raise WiringError(f"{text!r} is not a positive whole number of nanoseconds")
    return int(value)


def load_world(path: Path) -> World:
    """Read a world file; `urdf` of each body becomes an absolute path.

    Raises WiringError that lists all mistakes, each with file and line.
    """
    source = Source(path)
    problems = find_problems(source.data, World)
    source.refuse(problems)
    world = msgspec.convert(source.data, World)
    bodies: dict[str, Body] = {}
    for name, body in world.bodies.items():
        problems += _settings_problems(name, body)
        try:
            bodies[name] = msgspec.structs.replace(body, urdf=str(_find(body.urdf, path.parent)))
        except WiringError as exc:
            problems.append((("bodies", name, "urdf"), str(exc)))
    source.refuse(_world_problems(world) + problems)
    return msgspec.structs.replace(world, bodies=bodies)


def _world_problems(world: World) -> list[Problem]:
    problems: list[Problem] = []
    if not world.bodies:
        problems.append((("bodies",), "is empty; a world needs at least one body"))
    if world.physics_step is not None and world.substeps is not None:
        problems.append((("substeps",), "choose one of 'physics_step' and 'substeps'"))
    if world.physics_step is not None:
        try:
            duration_ns(world.physics_step)
        except WiringError as exc:
            problems.append((("physics_step",), str(exc)))
    return problems


def _settings_problems(name: str, body: Body) -> list[Problem]:
    """Return the contradictions among the settings of each joint of a body."""
    rows: dict[Where, JointSettings] = {("joint_defaults",): body.joint_defaults}
    rows |= {("joints", key): row.over(body.joint_defaults) for key, row in body.joints.items()}
    problems: list[Problem] = []
    for key, row in rows.items():
        where = ("bodies", name, *key)
        if row.lower is not None and row.upper is not None and row.lower > row.upper:
            problems.append((where, f"lower {row.lower} is above upper {row.upper}"))
        if row.friction and (row.mode or "torque") != "torque":
            problems.append((where, f"friction needs mode torque, not {row.mode}"))
    return problems


def _find(urdf: str, folder: Path) -> Path:
    path = package_path(urdf) if urdf.startswith("package://") else folder / urdf
    if not path.is_file():
        raise WiringError(f"no file {urdf!r} ({path})")
    return path.resolve()
