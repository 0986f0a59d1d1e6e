"""What a world file may say: every key, declared once.

Relative file names are relative to the world file. Lengths [m], angles [rad], torques [N·m]; for
prismatic joints read [m] and [N] where an angle and a torque are named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from stepbus_participant import (
    Count,
    Duration,
    File,
    Finite,
    NonNegative,
    Positive,
    Settings,
    Share,
    Vector3,
    Whole,
    parameters,
)
from stepbus_participant.parameters import Keys, Problems, read

Actuation = Literal["direct", "velocity_force"]
OwnMode = Literal["torque", "velocity", "position", "teleport"]
Pixels = Annotated[int, msgspec.Meta(ge=1, le=4096)]


class JointSettings(Settings):
    """What the world says about a joint, over what its URDF says; absent: the URDF holds."""

    mode: OwnMode | None = None
    """What commands mean to it: the only mode it takes. Default: torque."""
    motor: bool | None = None
    """Whether it has a motor; a joint without one swings freely. Default: true."""
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


class Friction(Settings):
    """Contact friction of all links of a body [-]; absent: PyBullet's or the URDF's."""

    lateral: NonNegative | None = None
    """Against sliding [-]."""
    rolling: NonNegative | None = None
    """Against rolling [m]."""
    spinning: NonNegative | None = None
    """Against turning on the spot [m]."""


class Body(Settings):
    """A body, read from a URDF."""

    urdf: File
    """Beside the world file, absolute, or `package://<package>/<path>`."""
    srdf: File | None = None
    """File that names the pairs of links that never collide; the other pairs then do. It is found
    like `urdf`. Absent: the links of this body pass through one another."""
    visuals: bool = True
    """Whether to load the shapes that only cameras see."""
    position: Vector3 = (0.0, 0.0, 0.0)
    """Position of the base in the world [m]."""
    orientation_rpy: Vector3 = (0.0, 0.0, 0.0)
    """Orientation of the base in the world: roll, pitch, yaw about fixed axes [rad]."""
    fixed_base: bool = False
    """Whether the base cannot move."""
    friction: Friction = Friction()
    """Contact friction of all its links."""
    joint_defaults: JointSettings = JointSettings()
    """Holds for every joint of the body."""
    joints: dict[str, JointSettings] = {}
    """Joint of the URDF → settings over `joint_defaults`."""


class BaseRow(Settings):
    """A mobile base with two driven wheels on one axle."""

    left: str
    """Joint of the left wheel; it has mode velocity, and turns forward by positive angles."""
    right: str
    """Joint of the right wheel, likewise."""
    wheel_radius: Positive
    """[m]"""
    track: Positive
    """Distance between the wheels [m]."""


class GripperRow(Settings):
    """A gripper with two prismatic fingers, which are coupled."""

    left: str
    """Joint of one finger; it has mode velocity, and opens by positive positions."""
    right: str
    """Joint of the other finger, likewise."""
    speed: Positive = 0.1
    """Largest velocity of each finger [m/s]."""


class ContactsRow(Settings):
    """A sensor of contacts."""

    links: tuple[str, ...] | None = None
    """Links whose contacts it shows; `<body>/*`: all links of a body. Default: all."""
    within: NonNegative = 0.0
    """It also shows what is this near to `links` and does not touch them, with force 0 [m]."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield a distance that nothing is measured from."""
        if self.within and self.links is None:
            yield ("within",), "needs 'links', the ones to measure the distance from"


class CameraRow(Settings):
    """A camera that shows colours and depth."""

    link: str
    """Its optical frame: z is the direction of view, x is right, y is down."""
    period_ns: Duration
    """From one image to the next, e.g. `400ms`; a multiple of the plant's step."""
    width: Pixels = 320
    """[pixel]"""
    height: Pixels = 240
    """[pixel]"""
    fov: Positive = 1.0
    """Angle of view from the top to the bottom of the image [rad]."""
    near: Positive = 0.05
    """What is nearer than this is not seen [m]."""
    far: Positive = 3.0
    """What is farther than this is not seen [m]."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what no camera can have."""
        if self.fov >= math.pi:
            hint = f"is it in degrees? {self.fov:g}° is {math.radians(self.fov):.4f} rad"
            yield ("fov",), f"{self.fov:g} rad is half a turn or more; {hint}"
        if self.near >= self.far:
            yield ("near",), f"{self.near:g} m is not less than 'far', {self.far:g} m"


class KindRow(Settings):
    """A kind of goods."""

    urdf: File
    """Found like that of a body; one link, whose origin is in the middle of the bottom."""
    mass: Positive
    """[kg]; the inertia of the URDF scales with it."""
    friction: NonNegative = 0.8
    """Lateral friction [-]; it multiplies with that of what touches the item."""
    spinning_friction: NonNegative = 0.002
    """[-]"""


class PlacesRow(Settings):
    """A row of places, counted from 1, from left to right for who faces it."""

    position: Vector3
    """The middle of the row, where items stand, in the world [m]."""
    count: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    """How many places."""
    pitch: Positive
    """From one place to the next [m]."""
    yaw: Finite = 0.0
    """Direction in which somebody in front of the row looks; items are turned alike [rad]."""


class SpreadRow(Settings):
    """How much items differ from one another: half of the width of each uniform distribution."""

    position: NonNegative = 0.003
    """Along the row and across it [m]."""
    yaw: NonNegative = 0.05
    """[rad]"""
    mass: Share = 0.03
    """Relative to the kind's [-]."""
    friction: Share = 0.05
    """Relative to the kind's [-]."""


class StockRow(Settings):
    """The stock of a world."""

    kinds: dict[str, KindRow]
    """Kind → what it is."""
    places: dict[str, PlacesRow]
    """Row → its places."""
    spread: SpreadRow = SpreadRow()
    """How much items differ from one another."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what a stock cannot be without."""
        for key, rows in (("kinds", self.kinds), ("places", self.places)):
            if not rows:
                yield (key,), "is empty; leave out the stock instead"


class KindChange(Settings):
    """What the plant's `params.stock` says about a kind, over the world file; absent: nothing."""

    mass: Positive | None = None
    friction: NonNegative | None = None
    spinning_friction: NonNegative | None = None


class StockParams(Settings):
    """`params.stock` of the plant."""

    seed: Whole = 0
    """Of the kind on each place, and of how items differ from one another."""
    kinds: dict[str, KindChange] = {}
    """Kind → what is different about it in this run."""
    fill: Share = 1.0
    """Share of the places that have an item [-]."""
    missing: tuple[str, ...] = ()
    """Items (`cola_a1_3`), places (`a1_3`), rows (`a1`) and kinds (`cola`) that are not there."""


class WorldFile(Settings):
    """What a world file says."""

    bodies: dict[str, Body]
    """Body → what it is; at least one."""
    bases: dict[str, BaseRow] = {}
    """Mobile base → its wheels."""
    grippers: dict[str, GripperRow] = {}
    """Gripper → its fingers."""
    contacts: dict[str, ContactsRow] = {}
    """Contact sensor → what it shows."""
    cameras: dict[str, CameraRow] = {}
    """Camera → what it shows."""
    gravity: Vector3 = (0.0, 0.0, -9.81)
    """[m/s²]"""
    physics_step_ns: Duration | None = None
    """Length of a physics substep, e.g. `1ms`; has to divide the communication step exactly."""
    substeps: Count | None = None
    """Physics substeps per communication step, instead of `physics_step`. Default: 1."""
    solver_iterations: Count = 50
    """Iterations of the solver of constraints in a substep."""
    sleeping: bool = False
    """Whether bodies that have come to rest are left out until something moves them: faster."""
    stock: StockRow | None = None
    """Goods on shelves; each becomes a body."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong between keys."""
        if not self.bodies:
            yield ("bodies",), "is empty; a world needs at least one body"
        if self.physics_step_ns is not None and self.substeps is not None:
            yield ("substeps",), "choose one of 'physics_step' and 'substeps'"


def read_world(path: Path) -> tuple[parameters.YamlFile, WorldFile, Problems]:
    """Return a world file, what it says, and what is wrong with that.

    Raises SettingsError when it is no YAML map.
    """
    source = parameters.read_yaml(path, "a world has at least bodies", file=str(path))
    problems = source.problems()
    return source, read(WorldFile, source.data, problems, folder=path.absolute().parent), problems
