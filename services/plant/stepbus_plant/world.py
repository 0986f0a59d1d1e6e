"""What a world file says: bodies and their joints, devices, sensors, and goods on shelves."""

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
    ModelFile,
    NonNegative,
    Positive,
    Problems,
    Settings,
    Share,
    Vector3,
    parameters,
)
from stepbus_participant.parameters import Keys, read
from stepbus_plant.world_sensors import (
    ImuSettings,
    LidarSettings,
    TransformSettings,
    WrenchSettings,
)

EngineName = Literal["pybullet", "mujoco"]
Actuation = Literal["direct", "velocity_force"]
OwnMode = Literal["torque", "velocity", "position", "teleport"]
Pixels = Annotated[int, msgspec.Meta(ge=1, le=4096)]


class JointSettings(Settings):
    """Settings of a joint that override its URDF; absent: the URDF's."""

    mode: OwnMode | None = None
    """Mode that its commands must have; `teleport` and `brake` are always accepted. Default:
    torque."""
    motor: bool | None = None
    """A joint without a motor swings freely; the plant warns about commands to it. Default:
    true."""
    mimic: bool | None = None
    """Whether a joint with `<mimic>` in its URDF follows the other joint; false: it is independent.
    Default: true."""
    actuation: Actuation | None = None
    """How to apply torques. Default: the plant's `actuation`, or direct."""
    position: Finite | None = None
    """Initial position [rad]. Default: the one nearest to 0 within the limits."""
    velocity: Finite | None = None
    """Initial velocity [rad/s]. Default: 0."""
    lower: Finite | None = None
    """Lower stop [rad]; a joint without stops in its URDF needs both or none. Default: the
    URDF's."""
    upper: Finite | None = None
    """Upper stop [rad]. Default: the URDF's."""
    effort: NonNegative | None = None
    """Torque limit of its motor [N·m]. Default: the URDF's."""
    max_velocity: NonNegative | None = None
    """Velocity limit in modes velocity and position [rad/s]; 0: none. Default: the URDF's."""
    brake: Positive | None = None
    """Deceleration in an emergency stop, in modes velocity and position [rad/s²]. A gripper that
    stops harder than it grips loses its object, and wheels that lock slide. Default: as fast as its
    torque allows."""
    damping: NonNegative | None = None
    """Viscous friction [N·m·s/rad]. Default: 0, whatever the URDF says."""
    friction: NonNegative | None = None
    """Coulomb friction [N·m]; only with mode torque and actuation direct. Default: 0, whatever the
    URDF says."""

    def over(self, defaults: JointSettings) -> JointSettings:
        """Return these settings, with those of `defaults` where they are absent."""
        given = {k: v for k, v in msgspec.structs.asdict(self).items() if v is not None}
        return msgspec.structs.replace(defaults, **given)


class Friction(Settings):
    """Contact friction of all links of a body [-]; absent: PyBullet's or the URDF's."""

    lateral: NonNegative | None = None
    """Friction against sliding [-]."""
    rolling: NonNegative | None = None
    """Friction against rolling [m]."""
    spinning: NonNegative | None = None
    """Friction against turning on the spot [m]."""


class Body(Settings):
    """A body, read from a URDF."""

    urdf: ModelFile
    """Relative to the world file, absolute, or `package://<package>/<path>`: an installed Python
    package such as `pybullet_data`, or a model package such as `example-robot-data`."""
    srdf: File | None = None
    """File with the pairs of links that never collide (`disable_collisions`); all other pairs of
    the body then collide. Without it, the links of a body do not collide with each other. Resolved
    like `urdf`."""
    visuals: bool = True
    """Whether to load the shapes that only cameras see; for Baxter this takes 3.5 s."""
    position: Vector3 = (0.0, 0.0, 0.0)
    """Position of the base in the world [m]."""
    orientation_rpy: Vector3 = (0.0, 0.0, 0.0)
    """Orientation of the base in the world: roll, pitch, yaw about fixed axes [rad]."""
    fixed_base: bool = False
    """Whether the base is fixed to the world."""
    friction: Friction = Friction()
    """Contact friction of all its links."""
    joint_defaults: JointSettings = JointSettings()
    """Settings for every joint of the body."""
    joints: dict[str, JointSettings] = {}
    """Joint → settings that override `joint_defaults`."""


class BaseSettings(Settings):
    """A mobile base with two driven wheels on one axle."""

    left: str
    """Joint of the left wheel; it has mode velocity, and positive angles drive forward."""
    right: str
    """Joint of the right wheel, likewise."""
    wheel_radius: Positive
    """[m]"""
    track: Positive
    """Distance between the wheels [m]."""


class GripperSettings(Settings):
    """A gripper with two prismatic fingers, which are coupled."""

    left: str
    """Joint of one finger; it has mode velocity, and positive positions open the gripper."""
    right: str
    """Joint of the other finger, likewise."""
    speed: Positive = 0.1
    """Largest velocity of each finger [m/s]."""


class ContactSensorSettings(Settings):
    """A sensor of contacts."""

    links: tuple[str, ...] | None = None
    """Links whose contacts it reports, named as in `poses`; `<body>/*` means all links of a body.
    Default: all."""
    within: NonNegative = 0.0
    """It also reports links of other bodies closer to `links` than this, with force 0 [m]; needs
    `links`."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield a distance that nothing is measured from."""
        if self.within and self.links is None:
            yield ("within",), "needs 'links', the ones to measure the distance from"


class CameraSettings(Settings):
    """An RGB-D camera."""

    link: str
    """Link with its optical frame: z forward, x right, y down."""
    period_ns: Duration | None = None
    """Period of the images, a multiple of the plant's step. Default: each step. An input of the
    plant that triggers the camera replaces it."""
    latency_ns: Duration | None = None
    """Time from an image to its message, a multiple of the plant's step; real cameras need it for
    exposure and transfer. The image is then drawn concurrently with the steps, on another core.
    Default: none."""
    width: Pixels = 320
    """[pixel]"""
    height: Pixels = 240
    """[pixel]"""
    fov: Positive = 1.0
    """Vertical field of view [rad]."""
    near: Positive = 0.05
    """Near clipping distance [m]."""
    far: Positive = 3.0
    """Far clipping distance [m]."""
    stride: Count = 1
    """A point cloud has every n-th pixel of every n-th row; this is n."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what no camera can have."""
        if self.fov >= math.pi:
            hint = f"is it in degrees? {self.fov:g}° is {math.radians(self.fov):.4f} rad"
            yield ("fov",), f"{self.fov:g} rad is half a turn or more; {hint}"
        if self.near >= self.far:
            yield ("near",), f"{self.near:g} m is not less than 'far', {self.far:g} m"


class ItemTypeSettings(Settings):
    """A type of item."""

    urdf: ModelFile
    """File, resolved like the URDF of a body; one link, with its origin in the middle of the
    bottom."""
    mass: Positive
    """Mass [kg]; scales the inertia of the URDF."""
    friction: NonNegative = 0.8
    """Lateral friction [-]; multiplied by that of the body that touches the item."""
    spinning_friction: NonNegative = 0.002
    """[-]"""


class RowSettings(Settings):
    """A row of slots, counted from 1, from left to right as seen from the front."""

    position: Vector3
    """Middle of the row, at the bottom of the items, in the world [m]."""
    count: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    """Number of slots."""
    pitch: Positive
    """Distance between two slots [m]."""
    yaw: Finite = 0.0
    """Heading that faces the row from the front; also the yaw of the items [rad]."""


class SpreadSettings(Settings):
    """Variation among items: half the width of each uniform distribution."""

    position: NonNegative = 0.003
    """Position along and across the row [m]."""
    yaw: NonNegative = 0.05
    """[rad]"""
    mass: Share = 0.03
    """Relative to the type's [-]."""
    friction: Share = 0.05
    """Relative to the type's [-]."""


class StockSettings(Settings):
    """The stock of a world."""

    types: dict[str, ItemTypeSettings]
    """Item types."""
    rows: dict[str, RowSettings]
    """Rows of slots."""
    spread: SpreadSettings = SpreadSettings()
    """Variation among items."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield an empty section."""
        for key, section in (("types", self.types), ("rows", self.rows)):
            if not section:
                yield (key,), "is empty; leave out the stock instead"


class WorldFile(Settings):
    """The content of a world file."""

    bodies: dict[str, Body]
    """Bodies, at least one."""
    bases: dict[str, BaseSettings] = {}
    """Mobile bases on two wheels."""
    grippers: dict[str, GripperSettings] = {}
    """Grippers with two fingers."""
    contacts: dict[str, ContactSensorSettings] = {}
    """Sensors of contact and proximity."""
    cameras: dict[str, CameraSettings] = {}
    """Cameras."""
    imus: dict[str, ImuSettings] = {}
    """Inertial measurement units."""
    wrenches: dict[str, WrenchSettings] = {}
    """Force-torque sensors."""
    lidars: dict[str, LidarSettings] = {}
    """Planar lidars."""
    transforms: dict[str, TransformSettings] = {}
    """Transforms of links."""
    gravity: Vector3 = (0.0, 0.0, -9.81)
    """[m/s²]"""
    physics_step_ns: Duration | None = None
    """Length of a physics substep; divides the plant's step (`step` × `every`) exactly. Default:
    the plant's step."""
    substeps: Count | None = None
    """Physics substeps per plant's step; instead of `physics_step`. Default: 1."""
    engine: EngineName | None = None
    """Physics engine, see [Engines](../guide/running/engines.md). Default: pybullet, or mujoco
    where PyBullet is not installed."""
    solver_iterations: Count = 50
    """Iterations of the engine's constraint solver."""
    sleeping: bool = False
    """Whether the physics skips bodies without joints that have been at rest for 2 s, until
    something moves them. 42 cans on shelves then take a third of the time."""
    stock: StockSettings | None = None
    """Goods on shelves; each becomes a body ([Stock](world.md#stock))."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong between keys."""
        if not self.bodies:
            yield ("bodies",), "is empty; a world needs at least one body"
        if self.physics_step_ns is not None and self.substeps is not None:
            yield ("substeps",), "choose one of 'physics_step' and 'substeps'"


def read_world(path: Path) -> tuple[parameters.YamlFile, WorldFile, Problems]:
    """Return a world file, its content, and its problems.

    Raises SettingsError when it is no YAML map.
    """
    source = parameters.read_yaml(path, "a world has at least bodies", file=str(path))
    problems = source.problems()
    return source, read(WorldFile, source.data, problems, folder=path.absolute().parent), problems
