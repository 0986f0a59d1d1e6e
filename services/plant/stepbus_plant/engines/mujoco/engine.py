"""The engine MuJoCo: builds the model of a world, and draws it."""

import math
from itertools import combinations

import mujoco
import numpy as np
from numpy.typing import NDArray

from stepbus_models import RobotDescription
from stepbus_models.mjcf import one_line
from stepbus_plant.engine import BASE, Gear, Light, Link, Loading, PhysicsError
from stepbus_plant.engines.mujoco.image import Painter
from stepbus_plant.engines.mujoco.model import add, rigid
from stepbus_plant.engines.mujoco.motors import add_motor
from stepbus_plant.engines.mujoco.space import Space
from stepbus_plant.geometry import Array, Pose
from stepbus_schemas import Point, WiringError

_FRICTION_RATIO = 10.0
_LEAST_RANGE = 1e-9
"""MuJoCo has no joint that is locked by its stops [rad]."""


class MujocoEngine(Space):
    """A world in MuJoCo, see `Engine`."""

    name = "mujoco"

    def __init__(self, step_s: float, gravity: Point, solver_iterations: int) -> None:
        super().__init__(mujoco.MjSpec(), step_s)
        option = self._spec.option
        option.timestep, option.gravity = step_s, gravity
        option.iterations = solver_iterations
        # What MuJoCo recommends for grippers: otherwise what is held or lies aslant creeps.
        option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, _FRICTION_RATIO
        # Otherwise MuJoCo begins anew where a state has diverged. Rows of islands are copies.
        disabled = mujoco.mjtDisableBit
        option.disableflags |= disabled.mjDSBL_AUTORESET | disabled.mjDSBL_ISLAND
        self._spec.compiler.degree = False
        self._painter: Painter | None = None

    def close(self) -> None:
        """See `Engine`."""
        if self._painter is not None:
            self._painter.close()
            self._painter = None

    # --- bodies ---------------------------------------------------------------------------

    def load(self, robot: RobotDescription, pose: Pose, options: Loading) -> int:
        """See `Engine`; cylinders are always exact. An MJCF says itself what collides."""
        number = len(self._bodies)
        try:
            body = add(self._spec, robot, number, pose, options)
        except WiringError:
            raise
        except (ValueError, mujoco.FatalError) as exc:
            raise PhysicsError(f"MuJoCo cannot read it: {one_line(exc)}") from exc
        self._bodies.append(body)
        for index, joint in enumerate(self.joints(number)):
            if robot.joints[joint].moves:
                add_motor(self._spec, body.joint_name(index), self._dt)
        if robot.format == "urdf" and not options.collides_with_itself:
            for pair in combinations(filter(self.is_solid, self.links(number).values()), 2):
                self.let_through(*pair)
        return number

    def notes(self, body: int) -> list[str]:
        """See `Engine`."""
        return self._bodies[body].notes

    def joints(self, body: int) -> list[str]:
        """See `Engine`."""
        return [joint for _, joint in self._bodies[body].rows[1:]]

    def links(self, body: int) -> dict[str, Link]:
        """See `Engine`; the number of a link is that of the last joint before it."""
        rows = self._bodies[body].rows
        return {name.strip(): (body, n + BASE) for n, (name, _) in enumerate(rows)}

    def is_solid(self, link: Link) -> bool:
        """See `Engine`."""
        body, index = link
        return self._bodies[body].rows[index - BASE][0] in self._bodies[body].solid

    def let_through(self, one: Link, other: Link) -> None:
        """See `Engine`."""
        first, second = (self._bodies[body].body_name(link) for body, link in (one, other))
        self._spec.add_exclude(bodyname1=first, bodyname2=second)

    # --- joints ---------------------------------------------------------------------------

    def set_joint(
        self, body: int, index: int, *, damping: float, lower: float, upper: float
    ) -> None:
        """See `Engine`; damping is implicit, and so always stable."""
        model, _ = self._now()
        joint = model.joint(self._bodies[body].joint_name(index))
        if damping != joint.damping[0]:
            joint.damping, model.dof_dampingpoly[joint.dofadr] = damping, 0.0
        joint.limited = math.isfinite(lower) and math.isfinite(upper)
        if joint.limited:
            joint.range = lower, max(upper, lower + _LEAST_RANGE)

    def couple(self, body: int, follower: int, leader: int, gear: Gear) -> None:
        """See `Engine`; as stiff as can be and without a limit, whatever the gear says."""
        name_of = self._bodies[body].joint_name
        self._spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=name_of(follower),
            name2=name_of(leader),
            data=[gear.offset, gear.multiplier, *[0.0] * 10],
            solref=rigid(self._dt),
        )

    # --- images ---------------------------------------------------------------------------

    def renderer(self) -> str:
        """See `Engine`."""
        return self._paint().renderer

    def image(
        self, size: tuple[int, int], view: Array, projection: Array, light: Light
    ) -> tuple[NDArray[np.uint8], Array]:
        """See `Engine`."""
        self._looked()
        return self._paint(*size).image(size, view, projection, light)

    def _paint(self, width: int = 640, height: int = 480) -> Painter:
        painter = self._painter
        if painter is None or width > painter.width or height > painter.height:
            self.close()
            self._painter = painter = Painter(*self._now(), width, height)
        return painter
