"""The frames of a recording as ROS has them (REP 105): map → odom → base → links → cameras."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

from stepbus_orchestrator.recording import Port
from stepbus_orchestrator.viewing.scene import (
    Frame,
    Joint,
    Messages,
    Pose,
    Robot,
    Scene,
    all_positions,
)

MAP = "map"
_ODOM = "odom"
_OPTICAL = ("_optical_frame", "_optical")
"""How the name of a frame with z ahead, x right and y down ends (REP 103)."""


@dataclass(frozen=True, kw_only=True)
class Transform:
    """A frame in its parent."""

    parent: str
    child: str
    pose: Pose


class FrameTree:
    """What stands still, and what moves when some ports have a message.

    A robot's frames are the links of its model. Where there are several robots, or a link is named
    like a frame of another body, they begin with its name and a slash.
    """

    def __init__(self, scene: Scene, ports: Sequence[Port]) -> None:
        bodies = {robot.name for robot in scene.robots}
        self._scene = scene
        self._others = [f for f in scene.frames if f.body not in bodies and not f.is_ghost]
        taken = {MAP, _ODOM, *(frame.name for frame in self._others)}
        self._trees = [
            RobotTree(robot, _prefix(robot, taken, is_only=len(scene.robots) == 1))
            for robot in scene.robots
        ]
        self._links = {frame.name: frame.name for frame in self._others}
        for tree in reversed(self._trees):
            self._links |= tree.names
        self._cameras = {
            port.topic: self.frame_of(link)
            for port in ports
            if port.type == "Image/1"
            and (link := next(iter(port.description.details.get("link", ())), ""))
        }

    @property
    def robots(self) -> "Sequence[RobotTree]":
        """Return the robots, each with its own frames."""
        return self._trees

    def frame_of(self, link: str) -> str:
        """Return the frame of a link, by the name that the plant has for it."""
        return self._links.get(link, link)

    def sensor_frame(self, port: Port) -> str:
        """Return the frame that a port's measurements are in."""
        if port.topic in self._cameras:
            return optical(self._cameras[port.topic])
        return self.frame_of(next(iter(port.names), "")) or MAP

    def base_of(self, port: Port) -> tuple[str, str]:
        """Return the frame that a port's pose of a base is in, and that of the base."""
        for tree in self._trees:
            if tree.robot.odometry == port.topic:
                return tree.odom, tree.root
        mobile = [tree.root for tree in self._trees if tree.robot.odometry]
        return MAP, mobile[0] if len(mobile) == 1 else ""

    def still(self) -> Iterator[Transform]:
        """Yield the frames that never move."""
        for frame in self._others:
            if frame.is_fixed:
                yield _of_frame(frame, frame.pose)
        yield from chain.from_iterable(tree.still() for tree in self._trees)
        for link in dict.fromkeys(self._cameras.values()):
            if optical(link) != link:
                yield Transform(parent=link, child=optical(link), pose=Pose())

    def moved(self, topics: frozenset[str], messages: Messages) -> Iterator[Transform]:
        """Yield the frames that the newest messages of some ports place."""
        found: dict[str, Pose] = {}
        for motion in self._scene.motions:
            if not motion.topics.isdisjoint(topics):
                found |= motion.poses(messages)
        for frame in self._others:
            if frame.name in found and not frame.is_fixed:
                yield _of_frame(frame, found[frame.name])
        for tree in self._trees:
            yield from tree.moved(topics, messages)


class RobotTree:
    """The frames of one robot. prefix: of their names. names: link, as the plant has it → frame."""

    def __init__(self, robot: Robot, prefix: str) -> None:
        self.robot = robot
        self.prefix = prefix
        self.root = prefix + robot.model.root
        self.odom = prefix + _ODOM
        self.names = {
            name: prefix + link
            for link in robot.model.links
            for name in (link, f"{robot.name}/{link}")
        }
        self._measured = {s.topic: self._moved_by(set(s.names)) for s in robot.sources}
        known = {joint.name for joints in self._measured.values() for joint in joints}
        moving = [joint for joint in robot.model.joints if joint.moves]
        self._seen = [j for j in moving if j.name not in known and j.child in robot.links]
        self._still = [j for j in robot.model.joints if j.name not in known and j not in self._seen]
        self._truth = frozenset(chain.from_iterable(robot.links.values()))

    def _moved_by(self, names: set[str]) -> list[Joint]:
        return [
            joint
            for joint in self.robot.model.joints
            if joint.moves and (joint.name in names or (joint.mimic or ("",))[0] in names)
        ]

    def still(self) -> Iterator[Transform]:
        """Yield the joints that never move, and the root where nothing moves it."""
        robot = self.robot
        for joint in self._still:
            yield self._joint(joint, joint.at(robot.model.position(joint, {})))
        if robot.odometry:
            if not robot.anchor:
                yield Transform(parent=MAP, child=self.odom, pose=robot.start)
        elif robot.is_fixed or not robot.anchor:
            yield Transform(parent=MAP, child=self.root, pose=robot.start)

    def moved(self, topics: frozenset[str], messages: Messages) -> Iterator[Transform]:
        """Yield what the newest messages of some ports place."""
        robot = self.robot
        positions = all_positions(robot.sources, messages)
        for topic in sorted(topics & self._measured.keys()):
            for joint in self._measured[topic]:
                yield self._joint(joint, joint.at(robot.model.position(joint, positions)))
        if robot.odometry in topics and (pose := robot.root_in_odom(messages)) is not None:
            yield Transform(parent=self.odom, child=self.root, pose=pose)
        if not topics.isdisjoint(self._truth):
            yield from self._by_truth(messages)

    def _by_truth(self, messages: Messages) -> Iterator[Transform]:
        """Yield map → odom, or → the root; and the joints that nothing else measures."""
        robot = self.robot
        root = None if robot.is_fixed else robot.root_in_world(messages)
        if root is not None and robot.odometry:
            in_odom = robot.root_in_odom(messages) or Pose()
            yield Transform(parent=MAP, child=self.odom, pose=root @ in_odom.inverse())
        elif root is not None:
            yield Transform(parent=MAP, child=self.root, pose=root)
        for joint in self._seen:
            parent = self._in_world(joint.parent, messages)
            child = robot.in_world(joint.child, messages)
            if parent is not None and child is not None:
                yield self._joint(joint, parent.inverse() @ child)

    def _in_world(self, link: str, messages: Messages) -> Pose | None:
        """Return the true pose of a link, by that of one that it is fixed to where it has none."""
        found = self.robot.in_world(link, messages)
        joint = self.robot.model.above.get(link)
        if found is not None or joint is None or joint.moves:
            return found
        parent = self._in_world(joint.parent, messages)
        return None if parent is None else parent @ joint.origin

    def _joint(self, joint: Joint, pose: Pose) -> Transform:
        return Transform(
            parent=self.prefix + joint.parent, child=self.prefix + joint.child, pose=pose
        )


def optical(link: str) -> str:
    """Return the optical frame of a camera's link; the plant's cameras have the same axes."""
    return link if link.endswith(_OPTICAL) else link + _OPTICAL[0]


def _prefix(robot: Robot, taken: set[str], *, is_only: bool) -> str:
    is_free = is_only and taken.isdisjoint(robot.model.links)
    return "" if is_free else f"{robot.name}/"


def _of_frame(frame: Frame, pose: Pose) -> Transform:
    return Transform(parent=frame.parent or MAP, child=frame.name, pose=pose)
