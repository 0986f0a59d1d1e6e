"""The seam between the plant and a physics engine.

An engine is a module of `engines` whose `ENGINE` makes an `Engine`; nothing else knows which it is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from stepbus_models import RobotDescription
from stepbus_plant.geometry import Array, Geometry, Pose
from stepbus_schemas import Point, RunError

Link = tuple[int, int]
"""The numbers of a body and one of its links."""
BASE = -1
"""Number of a body's root link; others have that of the joint above them."""
ANY_BODY, ANY_LINK = -1, -2
REST: Point = (0.0, 0.0, 0.0)
Indices = Sequence[int]
"""Numbers of joints of a body."""
Values = Sequence[float]
"""One value for each of these joints."""


class PhysicsError(RunError, ArithmeticError):
    """The physics engine failed, or its state is not finite."""


class Contact(NamedTuple):
    """A point where two links touch, or are close.

    on_one, on_other: where, on each of them [m]. normal: from the other one to the first.
    distance: [m], below 0 where they overlap. force: along the normal [N].
    """

    one: Link
    other: Link
    on_one: Point
    on_other: Point
    normal: Point
    distance: float
    force: float


class Loading(NamedTuple):
    """How a body is loaded.

    friction: of all links, `lateral`, `rolling`, `spinning`; absent: the model's. is_smooth: its
    cylinders are exact.
    """

    friction: Mapping[str, float] = {}
    is_fixed: bool = False
    collides_with_itself: bool = False
    has_visuals: bool = True
    is_smooth: bool = False


class Goal(NamedTuple):
    """What a motor tracks: a position [rad] and its velocity [rad/s].

    torque: the largest [N·m]. max_velocity: [rad/s]; 0: none. gain: share of the error that a
    substep corrects; 0: the engine's, 0.1.
    """

    position: float
    velocity: float
    torque: float
    max_velocity: float = 0.0
    gain: float = 0.0


class Gear(NamedTuple):
    """A coupling: q = multiplier · q of the leader + offset [rad or m].

    erp: share of the error that a substep corrects. force: the largest [N or N·m].
    """

    multiplier: float
    offset: float
    erp: float
    force: float


class Motion(NamedTuple):
    """Pose and velocity of a link in the world.

    frame: of the link. centre: of its mass [m]; velocity: of that [m/s]. spin: [rad/s].
    """

    frame: Pose
    centre: Point
    velocity: Point
    spin: Point


@dataclass(frozen=True, kw_only=True)
class Light:
    """White light on a scene.

    direction: towards it. distance: [m]. ambient, diffuse, specular: coefficients of what it does.
    """

    direction: Point
    distance: float
    ambient: float
    diffuse: float
    specular: float
    has_shadow: bool


class Engine(Protocol):
    """A world of bodies without a window. Bodies are numbered as they are loaded, from 0 on.

    Its bodies are loaded, coupled and let through each other before the first step or reading. An
    engine inherits what it does not do otherwise.

    For prismatic joints read [m] and [N] instead of [rad] and [N·m].
    name: as the world file has it. geometry: as it computes with poses.
    """

    name: str
    geometry: Geometry

    def __init__(self, step_s: float, gravity: Point, solver_iterations: int) -> None: ...

    def step(self) -> None:
        """Advance by one substep; raises PhysicsError when the engine fails."""
        ...

    def renderer(self) -> str:
        """Return what draws the images, with its version."""
        ...

    def unsaved(self, names: Sequence[str]) -> str:
        """Return why the state cannot be saved to the last bit; empty: it can.

        names: of the bodies.
        """
        return ""

    def save(self) -> bytes:
        """Return the state to the last bit, with contacts."""
        ...

    def restore(self, state: bytes) -> None:
        """Take what `save` returned of the same world."""
        ...

    def close(self) -> None:
        """Let go of everything; harmless when repeated."""
        ...

    # --- bodies ---------------------------------------------------------------------------

    def load(self, robot: RobotDescription, pose: Pose, options: Loading) -> int:
        """Load a body without damping or a limit of velocities; return its number.

        pose: of its root's frame. Raises WiringError for a robot that cannot be loaded.
        """
        ...

    def notes(self, body: int) -> list[str]:
        """Return what of a body's model is not used, a sentence each."""
        return []

    def joints(self, body: int) -> list[str]:
        """Return the names of all joints of a body, in the order of their numbers from 0 on."""
        ...

    def links(self, body: int) -> dict[str, Link]:
        """Return each link of a body by its name, the root first."""
        ...

    def is_solid(self, link: Link) -> bool:
        """Return whether a link has a collision shape."""
        ...

    def let_through(self, one: Link, other: Link) -> None:
        """Disable collisions between two links."""
        ...

    def let_sleep(self, body: int, *, now: bool = False) -> None:
        """Allow an engine to skip a body once it is at rest, or from now on, until it is moved."""

    def wake(self, body: int) -> None:
        """Wake up a body: a sleeping one would stay where it is put, even in the air."""

    # --- joints ---------------------------------------------------------------------------

    def read(self, body: int, indices: Sequence[int]) -> Any:
        """Return (position, velocity, reaction, torque of its motor) of joints of a body."""
        ...

    def put_joint(self, body: int, index: int, position: float, velocity: float) -> None:
        """Set position [rad] and velocity [rad/s] of a joint, regardless of forces."""
        ...

    def set_joint(
        self, body: int, index: int, *, damping: float, lower: float, upper: float
    ) -> None:
        """Set damping [N·m·s/rad] and stops [rad] of a joint; infinite: none."""
        ...

    def couple(self, body: int, follower: int, leader: int, gear: Gear) -> None:
        """Keep a joint where another one takes it, as by gears."""
        ...

    def push(self, body: int, indices: Indices, torques: Values) -> None:
        """Apply torques [N·m] to joints in the next substep only."""
        ...

    def turn(self, body: int, indices: Indices, velocities: Values, torques: Values) -> None:
        """Set motors that track velocities [rad/s] with limited torques [N·m] from now on."""
        ...

    def bring(self, body: int, index: int, goal: Goal) -> None:
        """Set a motor that tracks a position and its velocity with a limited torque."""
        ...

    def watch_reaction(self, joint: Link) -> None:
        """Measure from now on what everything beyond a joint exerts on it."""
        ...

    def reaction(self, joint: Link) -> tuple[Array, Array]:
        """Return the reaction of the latest substep: force [N] and torque [N·m], shape (3,) each.

        Both in the frame of the child's centre of mass, and about it.
        """
        ...

    def shove(self, link: Link, force: Point, torque: Point) -> None:
        """Add a force [N] at a link's centre of mass and a torque [N·m] in the next substep only.

        Both along the axes of the world. It wakes the body up, for which an engine may need the
        whole substep.
        """
        ...

    # --- poses ----------------------------------------------------------------------------

    def mass(self, link: Link) -> float:
        """Return the mass of a link [kg]; 0: it is fixed."""
        ...

    def inertial(self, link: Link) -> Pose:
        """Return the pose of a link's centre of mass in its frame."""
        ...

    def centre(self, body: int) -> Pose:
        """Return the pose of the centre of mass of a body's root link."""
        return self.geometry.compose(self.frame((body, BASE)), self.inertial((body, BASE)))

    def frame(self, link: Link) -> Pose:
        """Return the pose of a link's frame, that of the URDF."""
        ...

    def frames(self, body: int, indices: Sequence[int]) -> list[Pose]:
        """Return the frames of links other than the root."""
        return [self.frame((body, index)) for index in indices]

    def motion(self, link: Link) -> Motion:
        """Return pose and velocity of a link."""
        ...

    def put(self, body: int, frame: Pose, velocity: Point = REST, spin: Point = REST) -> None:
        """Put the frame of a body's root link somewhere; its joints stay as they are.

        velocity: of its centre of mass [m/s]. spin: angular velocity [rad/s].
        """
        ...

    def put_centre(self, body: int, pose: Pose, *, keeps_velocity: bool = False) -> None:
        """Put the centre of mass of a body's root link somewhere, at rest or moving as before."""
        ...

    # --- contacts, rays, images -----------------------------------------------------------

    def update_shapes(self) -> None:
        """Update the shapes that contacts, boxes and rays see to where they are now.

        Otherwise these are where they were in the latest substep, or when they were loaded.
        """
        ...

    def contacts(
        self, body: int = ANY_BODY, link: int = ANY_LINK, *, are_pressed: bool = False
    ) -> list[Contact]:
        """Return the contacts of the latest substep; of one body or link, it is the first one.

        are_pressed: only those with a force.
        """
        ...

    def closest(self, link: Link, within: float) -> list[Contact]:
        """Return the nearest points of a link and of links of other bodies, in their order.

        within: the largest distance [m].
        """
        ...

    def box(self, link: Link) -> tuple[Point, Point]:
        """Return the lower and the upper corner of the box around a link's collision shapes [m].

        It is that of the latest physics substep, and as much larger than the link as that moves in
        a substep. That of a link without shapes is around its centre of mass.
        """
        ...

    def forget_contacts(self, link: Link) -> None:
        """Forget the contacts of a link, which the next substep then finds anew."""

    def cast(self, starts: Array, ends: Array) -> Array:
        """Return how far along each ray the first hit is, from 0 to 1, or infinity.

        starts, ends: shape (n, 3) [m].
        """
        ...

    def image(
        self, size: tuple[int, int], view: Array, projection: Array, light: Light
    ) -> tuple[NDArray[np.uint8], Array]:
        """Return colours, shape (height, width, 3), and OpenGL's depth buffer, shape (h, w).

        size: width and height [pixel]. view, projection: OpenGL's matrices, shape (4, 4).
        """
        ...
