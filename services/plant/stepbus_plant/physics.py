"""A world in the physics engine: its bodies, links and joints by name."""

import dataclasses
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TypeVar

from stepbus_models import Mimic, RobotDescription, read_robot
from stepbus_participant import Problems, suggest
from stepbus_participant.parameters import Keys
from stepbus_plant.engine import BASE, Gear, Link, Loading, PhysicsError
from stepbus_plant.engines import default_engine, open_engine
from stepbus_plant.geometry import quaternion
from stepbus_plant.joint import Joint, make_joint
from stepbus_plant.models import hindered, loadable, pairs_without_collision
from stepbus_plant.params import Params
from stepbus_plant.world import Body, JointSettings
from stepbus_plant.world_file import World, fitted
from stepbus_schemas import WiringError

T = TypeVar("T")
_OWN = JointSettings()
_GEAR_ERP = 0.2
_GEAR_FORCE = 1e4
_STANDS = 1e-3
"""Gap below which a thing stands on what is beneath it [m]."""
_OPEN: list["Physics"] = []
"""In the order in which they were opened."""


class Physics:
    """An engine that holds a world.

    step_ns: length of a physics substep [ns]. params: default actuation of the joints, and effort
    limits that override the world's. problems: of the params; what is wrong is added.

    bodies: their names, in the engine's order. joints: the movable ones by name, in the order of
    the bodies and of their models; `body/joint` if two bodies share a name. fixed: names of the
    others. is_kinematic: nothing moves it but commands. robots: each body's model. notes: (body,
    sentence): what the engine computes otherwise than the models say. mistakes: in the world file.
    Without any, joints are at their start.

    Raises WiringError that lists every URDF that cannot be loaded, each with its line.
    """

    def __init__(self, world: World, step_ns: int, params: Params, problems: Problems) -> None:
        engine = params.engine or world.engine or default_engine()
        self.engine = open_engine(engine, step_ns * 1e-9, world.gravity, world.solver_iterations)
        self.world = world
        self.bodies = list(world.bodies)
        self.fixed: set[str] = set()
        self.robots: list[RobotDescription] = []
        self.notes: list[tuple[str, str]] = []
        self.mistakes: list[tuple[Keys, str]] = []
        self.is_kinematic = params.dynamics == "off"
        self._actuation = params.actuation
        self._followers: dict[Link, list[tuple[Joint, Mimic]]] = {}
        self._items: list[int] = []
        self._coupled: set[int] = set()
        self._loose: set[Link] = set()
        _OPEN.append(self)
        try:
            loaded = [row for name, body in world.bodies.items() for row in self._load(name, body)]
            if any(keys[-1] == "urdf" for keys, _ in self.mistakes):
                world.source.refuse(self.mistakes)
        except BaseException:
            self.close()
            raise
        self.joints = {
            name: dataclasses.replace(
                joint, name=name, effort=params.effort.get(name, joint.effort)
            )
            for name, joint in _by_name((name, joint.name, joint) for name, joint in loaded).items()
        }
        unknown = [name for name in params.effort if name not in self.joints]
        for name in unknown:
            problems.add(("effort",), f"joint {name!r} is unknown{suggest(name, self.joints)}")
        if not (self.mistakes or unknown):
            self._build()

    @cached_property
    def links(self) -> dict[str, Link]:
        """Every link by its name; `body/link` if two bodies share it."""
        return _by_name(
            (body, name, link)
            for number, body in enumerate(self.bodies)
            for name, link in self.engine.links(number).items()
        )

    def all_joints(self) -> dict[str, Link]:
        """Return the child link of every joint, fixed ones included, by the joint's name."""
        return _by_name(
            (body, joint, (number, index))
            for number, body in enumerate(self.bodies)
            for index, joint in enumerate(self.engine.joints(number))
        )

    def lacks_joint(self, name: str) -> str:
        """Return why no joint of a name can move, as the end of a sentence; empty: one can."""
        if name in self.joints:
            return ""
        if name in self.fixed:
            return "is fixed in its model"
        return f"is unknown{suggest(name, self.joints)}"

    def state(self, joint: Joint) -> tuple[float, float]:
        """Return position and velocity of a joint [rad, rad/s]."""
        position, velocity, *_ = self.engine.read(joint.body, [joint.index])[0]
        return position, velocity

    def teleport(self, joint: Joint, position: float, velocity: float) -> None:
        """Set position [rad] and velocity [rad/s] of a joint, regardless of forces.

        Those that follow it go along; a follower alone stays where it is.
        """
        if joint.mimic is not None:
            return
        self.engine.put_joint(joint.body, joint.index, position, velocity)
        for follower, mimic in self._followers.get((joint.body, joint.index), ()):
            where = mimic.multiplier * position + mimic.offset
            self.engine.put_joint(follower.body, follower.index, where, mimic.multiplier * velocity)

    def close(self) -> None:
        """Disconnect from the engine."""
        if self in _OPEN:
            _OPEN.remove(self)
        self.engine.close()

    # --- loading --------------------------------------------------------------------------

    def _load(self, name: str, body: Body) -> Iterator[tuple[str, Joint]]:
        """Load a body; yield its name and each of its movable joints, named as in the URDF."""
        item = self.world.items.get(name)
        friction = {
            key: value
            for key in ("lateral", "rolling", "spinning")
            if (value := getattr(body.friction, key)) is not None
        }
        try:
            robot = read_robot(body.urdf)
            robot = robot if item is None else fitted(item, robot)
            followed = {
                joint: robot.joints[joint].mimic
                for joint in robot.joints
                if body.joints.get(joint, _OWN).mimic is not False
            }
            loose = hindered(robot) & followed.keys() if robot.format == "urdf" else set()
            number = self.engine.load(
                loadable(robot, loose),
                (body.position, quaternion(body.orientation_rpy)),
                Loading(
                    friction,
                    is_fixed=body.fixed_base,
                    collides_with_itself=body.srdf is not None,
                    has_visuals=body.visuals,
                    is_smooth=item is not None,
                ),
            )
            if robot.format == "urdf":
                self._refuse_shapeless(robot, number)
        except (PhysicsError, WiringError) as exc:
            file = f"{body.urdf}: " if isinstance(exc, PhysicsError) else ""
            self.mistakes.append((("bodies", name, "urdf"), f"{file}{exc}"))
            return
        self.robots.append(robot)
        warnings = robot.warnings if robot.format == "urdf" else ()
        self.notes += [(f"body {name}", note) for note in (*warnings, *self.engine.notes(number))]
        if robot.format == "mjcf":
            self._coupled.add(number)
        names = self.engine.joints(number)
        self._loose |= {(number, names.index(joint)) for joint in loose}
        joints = self._joints_of(number, name, body, followed)
        self.fixed |= {joint.name for joint in robot.joints.values() if joint.type == "fixed"}
        if self.world.sleeping:
            # Motors do not wake a body up.
            if not joints:
                self.engine.let_sleep(number)
            self._items += [] if item is None else [number]
        self._disable_collisions(number, name, body)
        self._check_joints(name, body, joints)
        solid = map(self.engine.is_solid, self.engine.links(number).values())
        if not body.fixed_base and joints and not any(solid):
            text = "it is not fixed to the world and has no collision shape, so it falls"
            self.notes.append((f"body {name}", f"{text}; add `fixed_base: true`?"))
        yield from ((name, joint) for joint in joints)

    def _refuse_shapeless(self, robot: RobotDescription, number: int) -> None:
        """Raise WiringError for a link whose collision shapes the engine has dropped."""
        links = self.engine.links(number)
        for name, link in robot.links.items():
            if link.collisions and not self.engine.is_solid(links[name]):
                what = link.collisions[0].mesh or f"<{link.collisions[0].kind}>"
                raise WiringError(
                    f"{robot.path}: link {name!r} has a <collision> with {what}, of which engine "
                    f"{self.engine.name} makes no shape; give it a volume, or remove it"
                )

    def _disable_collisions(self, number: int, name: str, body: Body) -> None:
        """Disable the self-collisions of a body that its SRDF rules out."""
        if body.srdf is None:
            return
        keys = ("bodies", name, "srdf")
        try:
            pairs = pairs_without_collision(body.srdf)
        except WiringError as exc:
            self.mistakes.append((keys, str(exc)))
            return
        links = self.engine.links(number)
        for link in dict.fromkeys(link for pair in pairs for link in pair if link not in links):
            text = f"{body.srdf}: link {link!r} is unknown{suggest(link, links)}"
            self.mistakes.append((keys, text))
        for one, other in pairs:
            if one in links and other in links:
                self.engine.let_through(links[one], links[other])

    def _joints_of(
        self, number: int, name: str, body: Body, followed: Mapping[str, Mimic | None]
    ) -> list[Joint]:
        """Return the joints of a body that move, those with <mimic> as followers of others."""
        robot, names = self.robots[number], self.engine.joints(number)
        own = {joint: body.joints.get(joint, _OWN) for joint in names if robot.joints[joint].moves}
        joints = {
            joint: make_joint(
                (number, names.index(joint)),
                robot.joints[joint],
                settings.over(body.joint_defaults),
                actuation=self._actuation,
                damping=robot.joints[joint].damping if robot.format == "mjcf" else 0.0,
            )
            for joint, settings in own.items()
        }
        followers = {}
        for one, joint in joints.items():
            if (mimic := followed.get(one)) is None:
                continue
            leader = joints[mimic.joint]
            followers[one] = follower = joint.follow(leader, mimic)
            self._followers.setdefault((number, leader.index), []).append((follower, mimic))
            text = (
                f"follows joint {mimic.joint!r} (<mimic>); remove this key, or set `mimic: false`"
            )
            self.mistakes += [
                (("bodies", name, "joints", one, key), text)
                for key in ("position", "velocity", "mode")
                if getattr(own[one], key) is not None
            ]
        return list({**joints, **followers}.values())

    def _check_joints(self, name: str, body: Body, joints: Sequence[Joint]) -> None:
        known = [joint.name for joint in joints]
        self.mistakes += [
            (("bodies", name, "joints", given), f"unknown joint {given!r}{suggest(given, known)}")
            for given in body.joints
            if given not in known
        ]
        for joint in joints:
            keys = ("joints", joint.name) if joint.name in body.joints else ("joint_defaults",)
            self.mistakes += [
                (("bodies", name, *keys), f"joint {joint.name}: {text}")
                for text in joint.problems()
            ]

    def _start(self) -> None:
        """Set the limits, motors and start positions of all joints."""
        engine = self.engine
        for (body, leader), followers in self._followers.items():
            for follower, mimic in followers if body not in self._coupled else ():
                gear = Gear(mimic.multiplier, mimic.offset, _GEAR_ERP, _GEAR_FORCE)
                engine.couple(body, follower.index, leader, gear)
        for row in self.world.grippers.values():
            left, right = (self.joints.get(name) for name in (row.left, row.right))
            # Uncoupled fingers drift with the object. Mistakes in a gripper are found later.
            if left and right and left.body == right.body and left != right:
                gear = Gear(1.0, 0.0, erp=0.1, force=100.0)
                engine.couple(left.body, left.index, right.index, gear)
        for joint in self.joints.values():
            where = joint.body, joint.index
            is_loose = where in self._loose
            stops = (-math.inf, math.inf) if is_loose else (joint.lower, joint.upper)
            engine.set_joint(*where, damping=joint.damping, lower=stops[0], upper=stops[1])
            self.teleport(joint, joint.start, joint.start_velocity)
            engine.turn(joint.body, [joint.index], [0.0], [joint.friction])
        if self._items:
            engine.update_shapes()
        for number in self._items:
            # Items that stand on something sleep from the start; others fall first.
            if any(contact.distance < _STANDS for contact in engine.contacts(number)):
                engine.let_sleep(number, now=True)

    def _build(self) -> None:
        """Start, and let the engine build its world now: a mistake in it has a file."""
        try:
            self._start()
            self.engine.frame((0, BASE))
        except PhysicsError as exc:
            self.mistakes.append((("bodies",), str(exc)))


def open_worlds() -> list[Physics]:
    """Return the worlds that are open in this process, in the order in which they were opened."""
    return list(_OPEN)


def _by_name(rows: Iterable[tuple[str, str, T]]) -> dict[str, T]:
    """Return values by their name; `body/name` where bodies share one. rows: body, name, value."""
    rows = list(rows)
    counts = Counter(name for _, name, _ in rows)
    return {name if counts[name] == 1 else f"{body}/{name}": value for body, name, value in rows}
