"""The engine MuJoCo: bodies, joints and their motors, and the substep."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from stepbus_models import RobotDescription
from stepbus_plant.engine import (
    ANY_BODY,
    ANY_LINK,
    BASE,
    REST,
    Contact,
    Light,
    Link,
    Motion,
    PhysicsError,
)
from stepbus_plant.engines.mujoco.image import Painter
from stepbus_plant.engines.mujoco.model import LEAST_RANGE, Body, add, read, rigid
from stepbus_plant.engines.mujoco.motors import add_motor
from stepbus_plant.engines.mujoco.world import World
from stepbus_plant.geometry import Array, Geometry, Pose
from stepbus_schemas import Point, WiringError

_FRICTION_RATIO = 10.0


class MujocoEngine:
    """A world in MuJoCo, see `Engine`.

    The model is compiled when something first needs it, and again after what changes it.
    """

    name = "mujoco"
    draws_in_copies = False

    def __init__(self, step_s: float, gravity: Point, solver_iterations: int) -> None:
        self.geometry = Geometry()
        self._dt = step_s
        self._spec = mujoco.MjSpec()
        option = self._spec.option
        option.timestep, option.gravity = step_s, gravity
        option.iterations = solver_iterations
        # What MuJoCo recommends for grippers: otherwise what is held or lies aslant creeps.
        option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, _FRICTION_RATIO
        # Otherwise MuJoCo begins anew where a state has diverged. Rows of islands are copies.
        disabled = mujoco.mjtDisableBit
        option.disableflags |= disabled.mjDSBL_AUTORESET | disabled.mjDSBL_ISLAND
        self._spec.compiler.degree = False
        self._bodies: list[Body] = []
        self._waiting: list[Callable[[World], None]] = []
        self._painter: Painter | None = None
        self._compiled: World | None = None
        self._is_changed = True

    # --- the model ------------------------------------------------------------------------

    @property
    def _world(self) -> World:
        """The compiled model and its state."""
        if self._compiled is None or self._is_changed:
            self._compiled = self._compile()
            self._is_changed = False
            for act in self._waiting:
                act(self._compiled)
            self._waiting = []
        return self._compiled

    def _compile(self) -> World:
        before = self._compiled
        try:
            if before is None:
                model = self._spec.compile()
                data = mujoco.MjData(model)
            else:
                model, data = self._spec.recompile(before.model, before.data)
        except (ValueError, mujoco.FatalError) as exc:
            raise PhysicsError(f"MuJoCo cannot build the world: {_text(exc)}") from exc
        self._close_painter()
        world = World(model, data, self._bodies, self._dt)
        world.follow(before)
        return world

    def _then(self, act: Callable[[World], None]) -> None:
        """Change the state of the world once it is compiled, which takes its time."""
        if self._is_changed:
            self._waiting.append(act)
        else:
            act(self._world)

    def step(self) -> None:
        """See `Engine`."""
        self._world.step()

    def save(self) -> bytes:
        """See `Engine`."""
        return self._world.save()

    def restore(self, state: bytes) -> None:
        """See `Engine`."""
        self._world.restore(state)

    def close(self) -> None:
        """See `Engine`."""
        self._close_painter()

    def _close_painter(self) -> None:
        if self._painter is not None:
            self._painter.close()
            self._painter = None

    # --- bodies ---------------------------------------------------------------------------

    def load(
        self,
        robot: RobotDescription,
        pose: Pose,
        friction: Mapping[str, float],
        *,
        is_fixed: bool,
        collides_with_itself: bool,
        has_visuals: bool,
        is_smooth: bool,
    ) -> int:
        """See `Engine`; cylinders are always exact. An MJCF says itself what collides."""
        number = len(self._bodies)
        try:
            source = read(robot, friction, has_visuals=has_visuals, dt=self._dt)
            body = add(self._spec, robot, source, number, pose, is_fixed=is_fixed)
        except WiringError:
            raise
        except (ValueError, mujoco.FatalError) as exc:
            raise PhysicsError(f"MuJoCo cannot read it: {_text(exc)}") from exc
        self._bodies.append(body)
        for index, joint in enumerate(self.joints(number)):
            if robot.joints[joint].moves:
                add_motor(self._spec, body.joint_name(index), self._dt)
        if robot.format == "urdf" and not collides_with_itself:
            for one, other in combinations(sorted(body.solid), 2):
                self._let_through(f"{number}/{one}", f"{number}/{other}")
        self._is_changed = True
        return number

    def notes(self, body: int) -> list[str]:
        """See `Engine`."""
        return self._bodies[body].notes

    def joints(self, body: int) -> list[str]:
        """See `Engine`."""
        return [joint for _, joint in self._bodies[body].rows[1:]]

    def links(self, body: int) -> dict[str, Link]:
        """See `Engine`."""
        return {name: (body, index) for name, index in self._bodies[body].links().items()}

    def is_solid(self, link: Link) -> bool:
        """See `Engine`."""
        body, index = link
        return self._bodies[body].rows[index - BASE][0] in self._bodies[body].solid

    def let_through(self, one: Link, other: Link) -> None:
        """See `Engine`."""
        first, second = (self._bodies[body].body_name(link) for body, link in (one, other))
        self._let_through(first, second)

    def _let_through(self, one: str, other: str) -> None:
        self._spec.add_exclude(bodyname1=one, bodyname2=other)
        self._is_changed = True

    def let_sleep(self, body: int, *, now: bool = False) -> None:
        """Keep on computing it."""

    def wake(self, body: int) -> None:
        """Do nothing, as none sleeps."""

    # --- joints ---------------------------------------------------------------------------

    def read(self, body: int, indices: Sequence[int]) -> Any:
        """See `Engine`."""
        return self._world.read(body, indices)

    def put_joint(self, body: int, index: int, position: float, velocity: float) -> None:
        """See `Engine`."""
        self._then(lambda world: world.put_joint(body, index, position, velocity))

    def set_joint(
        self, body: int, index: int, *, damping: float, lower: float, upper: float
    ) -> None:
        """See `Engine`; damping is implicit, and so always stable."""
        own = self._bodies[body]
        described = own.robot.joints[self.joints(body)[index]]
        joint = self._spec.joint(own.joint_name(index))
        if damping != joint.damping[0]:
            joint.damping = [damping, 0.0, 0.0]
        is_limited = math.isfinite(lower) and math.isfinite(upper)
        stops = [lower, max(upper, lower + LEAST_RANGE)] if is_limited else [0.0, 0.0]
        if own.in_degrees and described.type != "prismatic":
            stops = [math.degrees(stop) for stop in stops]
        joint.limited, joint.range = int(is_limited), stops
        self._is_changed = True

    def couple(
        self,
        body: int,
        follower: int,
        leader: int,
        *,
        multiplier: float,
        offset: float = 0.0,
        erp: float,
        force: float,
    ) -> None:
        """See `Engine`; as stiff as can be and without a limit, whatever `erp` and `force` are."""
        name_of = self._bodies[body].joint_name
        self._spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=name_of(follower),
            name2=name_of(leader),
            data=[offset, multiplier, *[0.0] * 10],
            solref=rigid(self._dt),
        )
        self._is_changed = True

    def push(self, body: int, indices: Sequence[int], torques: Sequence[float]) -> None:
        """See `Engine`."""
        world = self._world
        _, dofs, _ = world.numbers(body, indices)
        world.data.qfrc_applied[dofs] = torques

    def turn(
        self,
        body: int,
        indices: Sequence[int],
        velocities: Sequence[float],
        torques: Sequence[float],
    ) -> None:
        """See `Engine`."""
        self._then(
            lambda world: world.motors.turn(world.numbers(body, indices)[2], velocities, torques)
        )

    def bring(
        self,
        body: int,
        index: int,
        position: float,
        velocity: float,
        torque: float,
        *,
        max_velocity: float = 0.0,
        gain: float = 0.0,
    ) -> None:
        """See `Engine`."""
        world, goal = self._world, (position, velocity)
        (motor,) = world.numbers(body, [index])[2]
        world.motors.bring(motor, goal, torque, max_velocity or math.inf, gain)

    def watch_reaction(self, joint: Link) -> None:
        """See `Engine`."""
        self._world.watch(joint)

    def reaction(self, joint: Link) -> tuple[Array, Array]:
        """See `Engine`."""
        return self._world.reactions[joint]

    # --- poses ----------------------------------------------------------------------------

    def mass(self, link: Link) -> float:
        """See `Engine`."""
        is_fixed = self._bodies[link[0]].is_fixed and link[1] == BASE
        return 0.0 if is_fixed else self._world.mass(link)

    def inertial(self, link: Link) -> Pose:
        """See `Engine`; along the axes of the link."""
        return self._world.inertial(link)

    def centre(self, body: int) -> Pose:
        """See `Engine`."""
        return self.geometry.compose(self.frame((body, BASE)), self.inertial((body, BASE)))

    def frame(self, link: Link) -> Pose:
        """See `Engine`."""
        return self._world.frame(link)

    def frames(self, body: int, indices: Sequence[int]) -> list[Pose]:
        """See `Engine`."""
        return [self._world.frame((body, index)) for index in indices]

    def motion(self, link: Link) -> Motion:
        """See `Engine`."""
        return self._world.motion(link)

    def put(self, body: int, frame: Pose, velocity: Point = REST, spin: Point = REST) -> None:
        """See `Engine`."""
        self._world.put(body, frame, velocity, spin)

    def put_centre(self, body: int, pose: Pose, *, keeps_velocity: bool = False) -> None:
        """See `Engine`."""
        frame = self.geometry.compose(pose, self.geometry.inverse(self.inertial((body, BASE))))
        if keeps_velocity:
            self._world.place(body, frame)
        else:
            self.put(body, frame)

    # --- contacts, rays, images -----------------------------------------------------------

    def update_shapes(self) -> None:
        """See `Engine`."""
        self._world.find_contacts()

    def contacts(
        self, body: int = ANY_BODY, link: int = ANY_LINK, *, are_pressed: bool = False
    ) -> list[Contact]:
        """See `Engine`."""
        found = self._world.contacts()
        if are_pressed:
            found = [contact for contact in found if contact.force > 0.0]
        if body == ANY_BODY:
            return found
        first = (_with_first(contact, body, link) for contact in found)
        return [contact for contact in first if contact is not None]

    def closest(self, link: Link, body: int, within: float, other: int = ANY_LINK) -> list[Contact]:
        """See `Engine`."""
        return self._world.looked().space.closest(link, body, within, other)

    def neighbours(self, link: Link, within: float) -> list[Link]:
        """See `Engine`."""
        return self._world.looked().space.neighbours(link, within)

    def box(self, link: Link) -> tuple[Point, Point]:
        """See `Engine`."""
        corners = self._world.looked().space.box(link)
        centre = self.motion(link).centre
        return corners or (centre, centre)

    def forget_contacts(self, link: Link) -> None:
        """Do nothing: each substep finds its contacts anew."""

    def cast(self, starts: Array, ends: Array) -> Array:
        """See `Engine`."""
        return self._world.looked().space.cast(starts, ends)

    def renderer(self) -> str:
        """See `Engine`."""
        return self._paint().renderer

    def image(
        self, size: tuple[int, int], view: Array, projection: Array, light: Light
    ) -> tuple[NDArray[np.uint8], Array]:
        """See `Engine`."""
        self._world.looked()
        return self._paint().image(size, view, projection, light)

    def _paint(self) -> Painter:
        world = self._world
        if self._painter is None:
            self._painter = Painter(world.model, world.data)
        return self._painter


def _with_first(contact: Contact, body: int, link: int) -> Contact | None:
    """Return a contact of a body, or of its link, as that link has it; None: it has no part."""

    def has(touching: Link) -> bool:
        return touching[0] == body and link in (ANY_LINK, touching[1])

    if has(contact.one):
        return contact
    if not has(contact.other):
        return None
    x, y, z = contact.normal
    return contact._replace(
        one=contact.other,
        other=contact.one,
        on_one=contact.on_other,
        on_other=contact.on_one,
        normal=(-x, -y, -z),
    )


def _text(error: Exception) -> str:
    """Return what MuJoCo says, on one line."""
    return " ".join(str(error).removeprefix("XML Error: ").removeprefix("Error: ").split())
