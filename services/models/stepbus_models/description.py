"""A robot as its model file describes it: links, joints, inertias and shapes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

from stepbus_schemas import Point

JointType = Literal["revolute", "continuous", "prismatic", "fixed", "ball"]
ShapeKind = Literal["box", "sphere", "cylinder", "capsule", "mesh", "plane"]

Moments = tuple[float, float, float, float, float, float]
"""ixx, iyy, izz, ixy, ixz, iyz [kg·m²]."""


@dataclass(frozen=True, kw_only=True)
class Pose:
    """The pose of a frame in its parent, as URDF gives it."""

    xyz: Point = (0.0, 0.0, 0.0)
    """Position [m]."""
    rpy: Point = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw about the fixed axes of the parent [rad]."""


@dataclass(frozen=True, kw_only=True)
class Inertial:
    """Mass and inertia of a link."""

    mass: float
    """[kg]."""
    moments: Moments
    """About the centre of mass, in the axes of `pose` [kg·m²]."""
    pose: Pose = Pose()
    """Centre of mass and axes, in the link's frame."""


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A visual or collision shape of a link."""

    kind: ShapeKind
    size: tuple[float, ...] = ()
    """box: its three edges; sphere: radius; cylinder, capsule: radius and length, without the
    caps [m]; mesh: scale about each axis [-]; plane: its normal [-]."""
    mesh: str = ""
    """File of a mesh: an absolute path, or the name in the model if there is no such file."""
    pose: Pose = Pose()
    """In the link's frame."""
    rgba: tuple[float, ...] | None = None
    """Red, green, blue and alpha, 0 to 1; None: the model gives none."""
    is_concave: bool = False
    """Whether PyBullet takes a mesh as it is, instead of its convex hull (`concave="yes"`)."""
    line: int = 0


@dataclass(frozen=True, kw_only=True)
class Link:
    """A rigid body of a robot."""

    name: str
    inertial: Inertial | None = None
    """None: the model gives none, or a joint moves it and nothing behind it has a mass. Engines
    give it a negligible mass."""
    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()
    gravity_compensation: float = 0.0
    """Part of the weight that the simulation carries, in an MJCF [-]."""
    contact: Mapping[str, float] = field(default_factory=dict)
    """Values of PyBullet's `<contact>` by tag, such as `lateral_friction`."""
    line: int = 0


@dataclass(frozen=True, kw_only=True)
class Mimic:
    """A joint that follows another one: q = multiplier · q of `joint` + offset [rad or m]."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint between two links."""

    name: str
    type: JointType
    """A revolute joint without stops is `continuous`. `ball` in an MJCF only."""
    parent: str
    child: str
    pose: Pose = Pose()
    """Of the child in the parent's frame, at position 0."""
    axis: Point = (1.0, 0.0, 0.0)
    """Unit vector in the child's frame."""
    lower: float | None = None
    """Lower position limit [rad or m]; None: no stop."""
    upper: float | None = None
    """Upper position limit [rad or m]; None where `lower` is."""
    effort: float | None = None
    """Largest torque [N·m] or force [N]; None: no limit is given."""
    velocity: float | None = None
    """Largest velocity [rad/s or m/s]; None: no limit is given."""
    damping: float = 0.0
    """[N·m·s/rad or N·s/m]."""
    friction: float = 0.0
    """Coulomb friction [N·m or N]."""
    armature: float = 0.0
    """Inertia of the motor, in an MJCF [kg·m² or kg]."""
    stiffness: float = 0.0
    """Of a spring, in an MJCF [N·m/rad or N/m]."""
    spring_rest: float = 0.0
    """Position at which the spring is relaxed [rad or m]."""
    mimic: Mimic | None = None
    line: int = 0

    @property
    def moves(self) -> bool:
        """Whether the joint has a position: neither a fixed nor a ball joint has one."""
        return self.type not in {"fixed", "ball"}


@dataclass(frozen=True, kw_only=True)
class RobotDescription:
    """A robot whose model file has been read and checked once.

    Every link but `root` is the child of exactly one joint.
    """

    name: str
    path: Path
    format: Literal["urdf", "mjcf"]
    """`urdf` also of xacro."""
    root: str
    """Name of the base link."""
    links: Mapping[str, Link]
    """By name, in the order of the file."""
    joints: Mapping[str, Joint]
    """By name, in the order of the file."""
    warnings: tuple[str, ...] = ()
    """What was repaired or left out, or is computed otherwise than the file says, a sentence
    each."""
    text: str = ""
    """The URDF as it was read; xacro is expanded. Empty for MJCF."""

    @cached_property
    def joint_above(self) -> Mapping[str, Joint]:
        """The joint whose child a link is, by the link's name."""
        return {joint.child: joint for joint in self.joints.values()}

    def place(self, line: int) -> str:
        """Return the start of a message: the file, with the line where it has one (above 0)."""
        return f"{self.path}:{line}" if line else str(self.path)
