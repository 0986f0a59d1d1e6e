"""The scene as a script sees it: objects with handles, aliases and poses.

It holds a second copy of the plant's world, which goes where the plant says that its bodies and
joints are: whatever a script asks of poses, distances or images is computed from that.
"""

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

from stepbus_coppelia.clients import ApiError
from stepbus_coppelia.messages import BodyStates
from stepbus_participant import suggest
from stepbus_plant.camera import Camera, Lens
from stepbus_plant.engine import BASE, REST, Link
from stepbus_plant.geometry import Geometry, Pose, quaternion
from stepbus_plant.joint import Joint
from stepbus_plant.params import CameraErrors
from stepbus_plant.physics import Physics
from stepbus_schemas import JointState, Point, Quaternion

SHAPE, JOINT, DUMMY, PROXIMITY, VISION = 0, 1, 4, 5, 9
"""CoppeliaSim's numbers for kinds of objects."""
NOWHERE: Pose = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
_MASK = 0xFFFFF
"""Above are flags."""
composed, inverse = Geometry().compose, Geometry().inverse
"""Return a pose of a frame in the world; the pose of the frame that a pose is given in."""
_INDEX, _COUNT = re.compile(r"\[(\d+)\]$"), re.compile(r"\{(\d+)\}$")


@dataclass
class SceneObject:
    """An object.

    handle, kind: numbers. alias: its name in paths; known: further ones. name: that of the link,
    joint, camera or sensor in the world. parent: its handle; -1: none. link: what it moves with;
    None: its parent. pose: in the frame of that. joint, camera, sensor: of an object of that kind.
    is_model: whether it is the root of a body. values: what the script has set of it, by
    CoppeliaSim's numbers.
    """

    handle: int
    kind: int
    alias: str
    name: str
    parent: int = -1
    link: Link | None = None
    pose: Pose = NOWHERE
    joint: Joint | None = None
    camera: Camera | None = None
    sensor: Any = None
    is_model: bool = False
    values: dict[str, Any] = field(default_factory=dict)
    known: list[str] = field(default_factory=list)

    @property
    def is_root(self) -> bool:
        """Return whether a body moves with it."""
        return self.kind == SHAPE and self.link is not None and self.link[1] == BASE


class Scene:
    """All objects, and the copy of the world that they are in.

    physics: the copy. aliases: path of CoppeliaSim → name in the world. sensors: proximity sensors
    by name, each with `link`, `position`, `orientation_rpy`. body_names: of the messages of a step;
    order: place of each of their joints in our lists. Raises ApiError for an alias or a sensor that
    names what is not in the world.
    """

    def __init__(
        self, physics: Physics, aliases: Mapping[str, str], sensors: Mapping[str, Any]
    ) -> None:
        self.objects: dict[int, SceneObject] = {}
        self._sensors, self._next = sensors, 10
        self.body_names, self.order = list[str](), list[int]()
        self._by_name: dict[tuple[int, str], SceneObject] = {}
        self.build(physics)
        # Last, since what is built anew has none.
        self._paths: dict[str, SceneObject] = {}
        # The first alias of an object names it.
        for path, name in reversed(list(aliases.items())):
            found = [o for (_, own), o in self._by_name.items() if own == name]
            if not found:
                known = suggest(name, [own for _, own in self._by_name])
                raise ApiError(f"aliases: {path!r} stands for {name!r}, which is unknown{known}")
            found[0].known.append(found[0].alias)
            found[0].alias = re.sub(r"[\[{#].*", "", path.strip("/").rpartition("/")[2])
            self._paths[path.strip("/")] = found[0]

    def build(self, physics: Physics) -> None:
        """Take a copy of the world; objects that were there before keep their handles."""
        self.physics, self.engine = physics, physics.engine
        self._by_link: dict[Link, SceneObject] = {}
        self._built: set[int] = set()
        self._bodies: BodyStates | None = None
        self._is_stale = False
        self.joint_index = {name: index for index, name in enumerate(physics.joints)}
        self.position = [joint.start for joint in physics.joints.values()]
        self.velocity = [joint.start_velocity for joint in physics.joints.values()]
        self.effort = [0.0] * len(self.position)
        for number, body in enumerate(physics.bodies):
            self._add_body(number, body)
        lens = Lens(CameraErrors(), 0)
        for name, row in physics.world.cameras.items():
            link = self._link(row.link, f"camera {name}")
            camera = Camera(name, row, link, self.engine, lens)
            # CoppeliaSim's sensor looks along z with x to the left and y up.
            turn: Pose = (REST, (0.0, 0.0, 1.0, 0.0))
            self._add(VISION, name, name, self._by_link[link], link=link, pose=turn, camera=camera)
        for name, sensor in self._sensors.items():
            link = self._link(sensor.link, f"proximity_sensors: {name}")
            pose = (sensor.position, quaternion(sensor.orientation_rpy))
            above = self._by_link[link]
            self._add(PROXIMITY, name, name, above, link=link, pose=pose, sensor=sensor)
        for thing in list(self.objects.values()):
            # What another world had.
            if thing.link is not None and thing.handle not in self._built:
                self.remove(thing)
        self._start = [self.engine.frame((n, BASE)) for n in range(len(physics.bodies))]

    def reset(self) -> None:
        """Put everything where it is before a simulation."""
        for joint in self.physics.joints.values():
            self.move_joint(joint, joint.start)
        for number, frame in enumerate(self._start):
            self.engine.put(number, frame)
        self.velocity = [joint.start_velocity for joint in self.physics.joints.values()]
        self.effort = [0.0] * len(self.position)
        self._is_stale = False
        self.engine.update_shapes()

    # --- building -------------------------------------------------------------------------

    def _add_body(self, number: int, body: str) -> None:
        """Add the links and joints of a body, from its root on."""
        robot, links = self.physics.robots[number], self.engine.links(number)
        names = self.engine.joints(number)
        own = {j.index: j for j in self.physics.joints.values() if j.body == number}
        shared = {link: name for name, link in self.physics.links.items()}
        root = self._add(SHAPE, body, body, None, link=(number, BASE), is_model=True)
        self._by_name.setdefault((SHAPE, shared[number, BASE]), root)
        found = [robot.root]
        for parent in found:
            for described in (row for row in robot.joints.values() if row.parent == parent):
                above, link = self._by_link[links[parent]], links[described.child]
                if (joint := own.get(names.index(described.name))) is not None:
                    named = described.name, joint.name
                    above = self._add(JOINT, *named, above, link=link, joint=joint)
                self._add(SHAPE, described.child, shared[link], above, link=link)
                found.append(described.child)

    def _add(
        self, kind: int, alias: str, name: str, parent: SceneObject | None, **fields: Any
    ) -> SceneObject:
        if (made := self._by_name.get((kind, name))) is None:
            above = -1 if parent is None else parent.handle
            made = SceneObject(self._next, kind, alias, name, above)
            self._next += 1
            self.objects[made.handle] = self._by_name[kind, name] = made
        self._built.add(made.handle)
        for key, value in fields.items():
            setattr(made, key, value)
        if kind == SHAPE and made.link is not None:
            self._by_link[made.link] = made
        return made

    def _link(self, name: str, whose: str) -> Link:
        if (link := self.physics.links.get(name)) is None:
            known = suggest(name, self.physics.links)
            raise ApiError(f"{whose}: link {name!r} is unknown{known}")
        return link

    def add_dummy(self) -> SceneObject:
        """Add an object without a body, such as a frame or a mark."""
        return self._add(DUMMY, "Dummy", f"~{self._next}", None)

    def add_shape(self, name: str) -> SceneObject:
        """Add a shape whose body the next copy of the world has."""
        return self._add(SHAPE, name, name, None, is_model=True)

    def remove(self, thing: SceneObject) -> None:
        """Remove an object; what is below it goes to its parent."""
        self._by_name = {key: o for key, o in self._by_name.items() if o is not thing}
        for other in self.objects.values():
            if other.parent == thing.handle:
                other.pose = composed(thing.pose, other.pose)
                other.parent = thing.parent
        del self.objects[thing.handle]

    # --- finding --------------------------------------------------------------------------

    def get(self, handle: object) -> SceneObject:
        """Return an object by its handle; raises ApiError."""
        own = int(handle) & _MASK if isinstance(handle, int | float) and handle >= 0 else -1
        if (found := self.objects.get(own)) is None:
            raise ApiError("object does not exist.")
        return found

    def of(self, link: Link) -> SceneObject:
        """Return the shape of a link."""
        return self._by_link[link]

    def body(self, thing: SceneObject) -> str:
        """Return the body that an object moves with."""
        return "" if thing.link is None else self.physics.bodies[thing.link[0]]

    def find(self, path: str, start: SceneObject | None = None, index: int = 0) -> int:
        """Return the handle of what a path names, or -1; start: what `.` is; index: which of them.

        `/a/b`, `./a`, `../a`, `a[1]`, `a{1}`, `*`: each part is looked for in the whole tree below
        the part before it, level by level; `[1]` counts siblings, `{1}` all that fit.
        """
        named = self._paths.get(path.strip("/"))
        if named is not None and named.handle in self.objects and index == 0:
            return named.handle
        if path[:1] not in ("/", ".", ":"):
            return -1
        here = None if path.startswith("/") else start
        parts = [part for part in path.split("/") if part not in ("", ".")]
        while parts and parts[0] in ("..", ":"):
            is_up = parts.pop(0) == ".."
            while here is not None and not (is_up or here.is_model):
                here = self.objects.get(here.parent)
            here = self.objects.get(here.parent) if is_up and here is not None else here
        if not parts:
            return -1 if here is None else here.handle
        if (given := _COUNT.search(parts[-1])) is not None:
            parts[-1], index = parts[-1][: given.start()], int(given[1])
        found = self._fitting(-1 if here is None else here.handle, parts)
        return next(itertools.islice(found, index, None), -1)

    def _fitting(self, parent: int, parts: Sequence[str]) -> Iterator[int]:
        """Yield what fits the parts of a path below an object, in CoppeliaSim's order."""
        given = _INDEX.search(parts[0])
        alias = parts[0][: given.start()] if given else parts[0]
        children = [o for o in self.objects.values() if o.parent == parent]
        pattern = alias.replace("[", "[[]")
        fitting = [o for o in children if any(fnmatchcase(n, pattern) for n in (o.alias, *o.known))]
        wanted = fitting[int(given[1]) :][:1] if given else fitting
        for thing in wanted:
            if len(parts) == 1:
                yield thing.handle
            else:
                yield from self._fitting(thing.handle, parts[1:])
        for thing in children:
            if not given or (thing not in fitting and not wanted):
                yield from self._fitting(thing.handle, parts)

    def below(self, top: SceneObject | None) -> Iterator[SceneObject]:
        """Yield everything below an object, or everything, the nearest first."""
        level = [-1 if top is None else top.handle]
        while level:
            found = [o for o in self.objects.values() if o.parent in level]
            yield from found
            level = [o.handle for o in found]

    def path(self, thing: SceneObject) -> str:
        """Return the path of an object, from the model that it belongs to on."""
        names = [thing.alias]
        while (above := self.objects.get(thing.parent)) is not None:
            thing = above
            if thing.is_model or thing.parent == -1:
                names.append(thing.alias)
        return "/" + "/".join(reversed(names))

    # --- where everything is --------------------------------------------------------------

    def velocity_of(self, thing: SceneObject) -> tuple[Point, Point]:
        """Return velocity of an object's origin [m/s], and its angular velocity [rad/s]."""
        above = thing
        while above.link is None and above.parent != -1:
            above = self.objects[above.parent]
        if above.link is None:
            return REST, REST
        motion = self.engine.motion(above.link)
        x, y, z = (p - c for p, c in zip(self.world_pose(thing)[0], motion.centre, strict=True))
        (a, b, c), (u, v, w) = motion.spin, motion.velocity
        return (u + b * z - c * y, v + c * x - a * z, w + a * y - b * x), motion.spin

    def take(self, state: JointState, bodies: BodyStates | None) -> None:
        """Take the state of a step."""
        for name in ("position", "velocity", "effort"):
            if (values := getattr(state, name)) is not None:
                for index, value in zip(self.order, values, strict=True):
                    getattr(self, name)[index] = value
        self._bodies, self._is_stale = bodies, True

    def settle(self) -> None:
        """Put the copy of the world where the plant's is, before something is asked of it."""
        if not self._is_stale:
            return
        self._is_stale = False
        joints = self.physics.joints.values()
        for joint, *state in zip(joints, self.position, self.velocity, strict=True):
            self.engine.put_joint(joint.body, joint.index, *state)
        if (bodies := self._bodies) is not None:
            frames = zip(bodies.position, bodies.orientation, strict=True)
            rows = zip(self.body_names, frames, bodies.velocity, bodies.spin, strict=True)
            for name, frame, velocity, spin in rows:
                self.engine.put(self.physics.bodies.index(name), frame, velocity, spin)
        self.engine.update_shapes()

    def move_joint(self, joint: Joint, position: float) -> None:
        """Put a joint of the copy somewhere."""
        index = self.joint_index[joint.name]
        self.position[index], self.velocity[index] = position, 0.0
        self.physics.teleport(joint, position, 0.0)

    def world_pose(self, thing: SceneObject, *, moves: bool = False) -> Pose:
        """Return the pose of an object in the world; that of a joint has its axis along z.

        moves: of a joint, the frame that moves with it.
        """
        if thing.joint is not None and thing.link is not None:
            joint, child = thing.joint, self.engine.frame(thing.link)
            q = 0.0 if moves else self.position[self.joint_index[joint.name]]
            x, y, z = joint.axis
            shift = REST if joint.is_rotary else (-x * q, -y * q, -z * q)
            frame = composed(child, (shift, _about(joint.axis, -q * joint.is_rotary)))
            return composed(frame, (REST, _from_up(joint.axis)))
        if thing.link is not None:
            return composed(self.engine.frame(thing.link), thing.pose)
        return self.out_of(thing.pose, self.objects.get(thing.parent))

    def into(self, pose: Pose, frame: SceneObject | None) -> Pose:
        """Return a pose of the world in the frame of an object; None: the world."""
        return pose if frame is None else relative(self.world_pose(frame, moves=True), pose)

    def out_of(self, pose: Pose, frame: SceneObject | None) -> Pose:
        """Return a pose in the frame of an object in the world."""
        return pose if frame is None else composed(self.world_pose(frame, moves=True), pose)

    def move(self, thing: SceneObject, pose: Pose) -> None:
        """Put an object somewhere in the copy; raises ApiError for what only joints move."""
        if thing.link is None or thing.kind in (VISION, PROXIMITY):
            above = self.objects.get(thing.parent) if thing.link is None else self.of(thing.link)
            thing.pose = self.into(pose, above)
        elif thing.is_root:
            self.engine.put(thing.link[0], pose)
        else:
            what = f"{self.path(thing)} is a link of {self.path(self.of((thing.link[0], BASE)))}"
            text = "which only its joints move; move that object instead"
            raise ApiError(f"{what}, {text}")


def relative(frame: Pose, pose: Pose) -> Pose:
    """Return a pose of the world in a frame."""
    return composed(inverse(frame), pose)


def _about(axis: Point, angle: float) -> Quaternion:
    x, y, z = axis
    sine = math.sin(angle / 2) / (math.sqrt(x * x + y * y + z * z) or 1.0)
    return x * sine, y * sine, z * sine, math.cos(angle / 2)


def _from_up(axis: Point) -> Quaternion:
    """Return the shortest turn that takes z to an axis."""
    x, y, z = axis
    if z < -1.0 + 1e-9:
        return 1.0, 0.0, 0.0, 0.0
    w = 1.0 + z
    length = math.sqrt(x * x + y * y + w * w)
    return -y / length, x / length, 0.0, w / length
