"""The content of a world file: bodies and their joints, devices, sensors and stock."""

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
    Names,
    NonNegative,
    Own,
    Plugin,
    Positive,
    Problems,
    Settings,
    Vector3,
    parameters,
)
from stepbus_participant.parameters import Keys, read

EngineName = Literal["pybullet", "mujoco"]
Actuation = Literal["direct", "velocity_force"]
OwnMode = Literal["torque", "velocity", "position", "teleport"]
Pixels = Annotated[int, msgspec.Meta(ge=1, le=4096)]
Rays = Annotated[int, msgspec.Meta(ge=1, le=10_000)]
WORLD = "world"


class JointSettings(Settings):
    """Settings of a joint that override its URDF; absent: the URDF's."""

    mode: OwnMode | None = None
    """Mode that commands to the joint must have; `teleport` and `brake` are always accepted.
    Default: torque."""
    motor: bool | None = None
    """Whether the joint has a motor. Without one it swings freely, and the plant warns about
    commands to it. Default: true."""
    mimic: bool | None = None
    """Whether a joint with `<mimic>` in its URDF follows the other joint. Default: true."""
    actuation: Actuation | None = None
    """How to apply torques. Default: the plant's `actuation`, or direct."""
    position: Finite | None = None
    """Initial position [rad]. Default: the one nearest to 0 within the limits."""
    velocity: Finite | None = None
    """Initial velocity [rad/s]. Default: 0."""
    lower: Finite | None = None
    """Lower stop [rad]; for a joint without limits in its URDF, set both stops or none.
    Default: the URDF's."""
    upper: Finite | None = None
    """Upper stop [rad]. Default: the URDF's."""
    effort: NonNegative | None = None
    """Torque limit of its motor [N·m]. Default: the URDF's."""
    max_velocity: NonNegative | None = None
    """Velocity limit in modes velocity and position [rad/s]; 0: none. Default: the URDF's."""
    brake: Positive | None = None
    """Deceleration in an emergency stop, in modes velocity and position [rad/s²]. If it is too
    high, a gripper loses its load and locked wheels slide. Default: as fast as the torque
    allows."""
    damping: NonNegative | None = None
    """Viscous friction [N·m·s/rad]. Default: 0; the URDF is ignored."""
    friction: NonNegative | None = None
    """Coulomb friction [N·m]; only with mode torque and actuation direct. Default: 0; the URDF
    is ignored."""

    def over(self, defaults: JointSettings) -> JointSettings:
        """Return these settings, with those of `defaults` where they are absent."""
        given = {k: v for k, v in msgspec.structs.asdict(self).items() if v is not None}
        return msgspec.structs.replace(defaults, **given)


class Friction(Settings):
    """Contact friction of all links of a body [-]; absent: PyBullet's or the URDF's."""

    lateral: NonNegative | None = None
    """Coefficient of sliding friction [-]."""
    rolling: NonNegative | None = None
    """Coefficient of rolling friction [m]."""
    spinning: NonNegative | None = None
    """Coefficient of spinning friction [m]."""


class Body(Settings):
    """A body, read from a URDF; with engine mujoco, from an MJCF, too."""

    urdf: File
    """Absolute, relative to the world file, or `package://<package>/<path>`, where the package
    is an installed Python package such as `pybullet_data` or a model package such as
    `example-robot-data`."""
    srdf: File | None = None
    """Lists the pairs of links that never collide (`disable_collisions`); all other pairs of
    the body then collide. Without it, links of one body do not collide with each other.
    Resolved like `urdf`."""
    visuals: bool = True
    """Whether to load the visual shapes, which only cameras see; for Baxter this takes 3.5 s."""
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
    """Settings per joint; they override `joint_defaults`."""


class BaseSettings(Settings):
    """A mobile base with two driven wheels on one axle."""

    left: str
    """Joint of the left wheel; it needs mode velocity, and positive angles drive forward."""
    right: str
    """Joint of the right wheel; same requirements."""
    wheel_radius: Positive
    """[m]"""
    track: Positive
    """Distance between the wheels [m]."""


class GripperSettings(Settings):
    """A gripper with two coupled prismatic fingers."""

    left: str
    """Joint of one finger; it needs mode velocity, and positive positions open the gripper."""
    right: str
    """Joint of the other finger; same requirements."""
    speed: Positive = 0.1
    """Largest velocity of each finger [m/s]."""


class ContactSensorSettings(Settings):
    """A sensor of contacts."""

    links: tuple[str, ...] | None = None
    """Links whose contacts it reports, named as in `poses`; `<body>/*` means all links of a
    body. Default: all."""
    within: NonNegative = 0.0
    """Also reports links of other bodies that are closer to `links` than this, with force 0
    [m]; needs `links`."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield a distance that nothing is measured from."""
        if self.within and self.links is None:
            yield ("within",), "needs 'links', from which distances are measured"


class CameraSettings(Settings):
    """An RGB-D camera."""

    link: str
    """Link that is its optical frame: z forward, x right, y down."""
    period_ns: Duration | None = None
    """Period of the images, a multiple of the plant's step. Default: each step. Ignored if an
    input of the plant triggers the camera."""
    latency_ns: Duration | None = None
    """Delay from image to message for exposure and transfer, a multiple of the plant's step.
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
    """Stride of a point cloud: it has every n-th pixel of every n-th row."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what no camera can have."""
        if self.fov >= math.pi:
            yield ("fov",), f"{self.fov:g} rad is half a turn or more; angles are in radians"
        if self.near >= self.far:
            yield ("near",), f"{self.near:g} m is not less than 'far', {self.far:g} m"


class ImuErrors(Settings):
    """Errors of an inertial unit, of each axis."""

    angular_velocity: NonNegative = 0.0
    """[rad/s]"""
    linear_acceleration: NonNegative = 0.0
    """[m/s²]"""
    orientation: NonNegative = 0.0
    """[rad]"""


class ImuSettings(Settings):
    """An inertial unit."""

    link: str
    """Link that carries the sensor; it measures in the frame of this link."""
    period_ns: Duration | None = None
    """Period of the readings, a multiple of the plant's step. Default: each step."""
    orientation: bool = True
    """Whether it also measures its orientation."""
    noise: ImuErrors = ImuErrors()
    """Standard deviation of Gaussian noise."""
    bias: ImuErrors = ImuErrors()
    """Standard deviation of a constant offset, drawn once per run."""


class WrenchErrors(Settings):
    """Errors of a force-torque sensor, of each axis."""

    force: NonNegative = 0.0
    """[N]"""
    torque: NonNegative = 0.0
    """[N·m]"""


class WrenchSettings(Settings):
    """A force-torque sensor."""

    joint: str
    """Joint that carries the sensor, of any type, including fixed."""
    period_ns: Duration | None = None
    """Period of the readings, a multiple of the plant's step. Default: each step."""
    noise: WrenchErrors = WrenchErrors()
    """Standard deviation of Gaussian noise."""
    bias: WrenchErrors = WrenchErrors()
    """Standard deviation of a constant offset, drawn once per run."""


class LidarSettings(Settings):
    """A planar lidar."""

    link: str
    """Link that carries the lidar; its rays lie in the x-y plane of the link's frame."""
    period_ns: Duration | None = None
    """Period of the scans, a multiple of the plant's step. Default: each step."""
    rays: Rays = 181
    """Number of rays."""
    angle_min: Finite = -1.5707963267948966
    """Angle of the first ray about z [rad]."""
    angle_max: Finite = 1.5707963267948966
    """Angle of the last ray [rad]."""
    range_min: NonNegative = 0.05
    """Smallest range that it measures [m]."""
    range_max: Positive = 10.0
    """Largest range that it measures [m]."""
    noise: NonNegative = 0.0
    """Standard deviation of Gaussian noise of each range [m]."""
    bias: NonNegative = 0.0
    """Standard deviation of a constant offset of all ranges, drawn once per run [m]."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield empty intervals of angles or ranges."""
        if self.angle_min > self.angle_max:
            yield ("angle_min",), f"{self.angle_min:g} rad is above 'angle_max', {self.angle_max:g}"
        if self.range_min >= self.range_max:
            yield ("range_min",), f"{self.range_min:g} m is not less than 'range_max'"


class TransformErrors(Settings):
    """Errors of transforms, of each axis."""

    position: NonNegative = 0.0
    """[m]"""
    orientation: NonNegative = 0.0
    """[rad]"""


class TransformSettings(Settings):
    """Transforms of links."""

    links: Names
    """Links whose frames are measured, named as in `poses`."""
    parent: str = WORLD
    """Reference frame: `world` or a link."""
    period_ns: Duration | None = None
    """Period of the readings, a multiple of the plant's step. Default: each step."""
    noise: TransformErrors = TransformErrors()
    """Standard deviation of Gaussian noise."""
    bias: TransformErrors = TransformErrors()
    """Standard deviation of a constant offset, drawn once per run."""


class StockSettings(Settings):
    """Bodies that a class adds to the world; it reads the other keys."""

    source: Plugin
    """Class that makes them: `file.py:Class` beside the world file, or `module:Class` of a
    package that declares participants."""
    own: Own = {}


class WorldFile(Settings):
    """The content of a world file."""

    bodies: dict[str, Body]
    """Bodies by name, at least one."""
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
    """Physics substeps per step of the plant; instead of `physics_step`. Default: 1."""
    engine: EngineName | None = None
    """Physics engine, see [Engines](../guide/running/engines.md). Default: pybullet, or mujoco
    where PyBullet is not installed."""
    solver_iterations: Count = 50
    """Iterations of the engine's constraint solver."""
    sleeping: bool = False
    """Whether the physics skips bodies without joints that have been at rest for 2 s, until
    something moves them. 42 cans on shelves then take a third of the computing time."""
    stock: StockSettings | None = None
    """Bodies that a class adds to the world ([Stock](world.md#stock))."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong between keys."""
        if not self.bodies:
            yield ("bodies",), "is empty; a world needs at least one body"
        if self.physics_step_ns is not None and self.substeps is not None:
            yield ("substeps",), "set either 'physics_step' or 'substeps', not both"


def read_world(path: Path) -> tuple[parameters.YamlFile, WorldFile, Problems]:
    """Return a world file, its content, and its problems.

    Raises SettingsError if it is not a YAML map.
    """
    source = parameters.read_yaml(path, "a world needs at least 'bodies'", file=str(path))
    problems = source.problems()
    return source, read(WorldFile, source.data, problems, folder=path.absolute().parent), problems
