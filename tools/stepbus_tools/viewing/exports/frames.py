"""The frames of a recording as ROS has them (REP 105): map → odom → base → links → cameras."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import NamedTuple

from stepbus_orchestrator.recording import Port
from stepbus_tools.viewing.scene.model import is_moved_by
from stepbus_tools.viewing.scene.pose import Pose
from stepbus_tools.viewing.scene.scene import Body, Messages, Scene, all_positions

_MAP = "map"
_ODOM = "odom"
_OPTICAL = ("_optical_frame", "_optical")
"""How the name of a frame with z ahead, x right and y down ends (REP 103)."""


class Transform(NamedTuple):
    """A frame in its parent."""

    parent: str
    child: str
    pose: Pose


class FrameTree:
    """What stands still, and what moves when some ports have a message.

    A frame has the name of its link. That of a robot begins with the robot's name and a slash where
    there are several robots; that of another body where the link's name is taken. world: the frame
    that true poses are in.
    """

    world = _MAP

    def __init__(self, scene: Scene, ports: Sequence[Port]) -> None:
        robots = [body for body in scene.bodies if body.model.has_joints]
        others = [body for body in scene.bodies if not body.model.has_joints]
        known = {body.name for body in scene.bodies}
        self._scene = scene
        self._loose = [f for f in scene.frames if f.body not in known and not f.is_ghost]
        taken = Counter([_MAP, _ODOM, *(frame.name for frame in self._loose)])
        taken.update(link for body in scene.bodies for link in body.model.links)
        is_only = len(robots) == 1 and robots[0].model.links.keys().isdisjoint((_MAP, _ODOM))
        self.robots = [BodyTree(body, "" if is_only else f"{body.name}/") for body in robots]
        self._trees = [*self.robots, *(BodyTree(body, "", taken) for body in others)]
        self._links = {frame.name: frame.name for frame in self._loose}
        for tree in reversed(self._trees):
            for link, frame in tree.frames.items():
                self._links |= {link: frame, f"{tree.body.name}/{link}": frame}
        self._cameras = {
            port.topic: self.frame_of(link)
            for port in ports
            if port.type == "Image/1"
            and (link := next(iter(port.description.details.get("link", ())), ""))
        }

    def frame_of(self, link: str) -> str:
        """Return the frame of a link, by the name that the plant has for it."""
        return self._links.get(link, link)

    def sensor_frame(self, port: Port) -> str:
        """Return the frame that a port's measurements are in."""
        if port.topic in self._cameras:
            return _optical(self._cameras[port.topic])
        return self.frame_of(next(iter(port.names), "")) or _MAP

    def base_of(self, port: Port) -> tuple[str, str]:
        """Return the frame that a port's pose of a base is in, and that of the base."""
        for tree in self.robots:
            if tree.body.odometry == port.topic:
                return tree.odom, tree.root
        mobile = [tree.root for tree in self.robots if tree.body.odometry]
        return _MAP, mobile[0] if len(mobile) == 1 else ""

    def still(self) -> Iterator[Transform]:
        """Yield the frames that never move."""
        yield from chain.from_iterable(tree.still() for tree in self._trees)
        for link in dict.fromkeys(self._cameras.values()):
            if _optical(link) != link:
                yield Transform(link, _optical(link), Pose())

    def moved(self, topics: frozenset[str], messages: Messages) -> Iterator[Transform]:
        """Yield the frames that the newest messages of some ports place."""
        poses = self._scene.poses(messages, topics)
        for frame in self._loose:
            if frame.name in poses:
                yield Transform(frame.parent or _MAP, frame.name, poses[frame.name])
        for tree in self._trees:
            yield from tree.moved(topics, messages)


class BodyTree:
    """The frames of one body.

    prefix: of their names. taken: how many links and frames have a name; one that is not alone
    begins with the name of the body.
    """

    def __init__(self, body: Body, prefix: str, taken: Mapping[str, int] = {}) -> None:
        self.body = body
        self.prefix = prefix
        self.frames = {
            link: f"{body.name}/{link}" if taken.get(link, 0) > 1 else prefix + link
            for link in body.model.links
        }
        self.root = self.frames[body.model.root]
        self.odom = prefix + _ODOM
        joints = {joint.name: joint for joint in body.model.joints}
        self._measured = {
            source.topic: [
                joints.pop(joint.name)
                for joint in list(joints.values())
                if is_moved_by(joint, source.names)
            ]
            for source in body.measured
        }
        self._seen = [j for j in joints.values() if j.moves and j.child in body.links]
        self._still = [joint for joint in joints.values() if joint not in self._seen]
        self._truth = frozenset(chain.from_iterable(body.links.values()))

    def still(self) -> Iterator[Transform]:
        """Yield the joints that never move, and the root where nothing moves it."""
        body = self.body
        for joint in self._still:
            yield self._of(joint.parent, joint.child, body.model.placed(joint, {}))
        if body.odometry:
            if not body.anchor:
                yield Transform(_MAP, self.odom, body.start)
        elif body.is_fixed or not body.anchor:
            yield Transform(_MAP, self.root, body.start)

    def moved(self, topics: frozenset[str], messages: Messages) -> Iterator[Transform]:
        """Yield what the newest messages of some ports place."""
        body = self.body
        positions = all_positions(body.measured, messages)
        for topic in sorted(topics & self._measured.keys()):
            for joint in self._measured[topic]:
                yield self._of(joint.parent, joint.child, body.model.placed(joint, positions))
        if body.odometry in topics and (pose := body.root_in_odom(messages)) is not None:
            yield Transform(self.odom, self.root, pose)
        if not topics.isdisjoint(self._truth):
            yield from self._by_truth(messages)

    def _by_truth(self, messages: Messages) -> Iterator[Transform]:
        """Yield map → odom, or → the root; and the joints that nothing else measures."""
        body = self.body
        root = None if body.is_fixed else body.root_in_world(messages)
        if root is not None and body.odometry:
            in_odom = body.root_in_odom(messages) or Pose()
            yield Transform(_MAP, self.odom, root @ in_odom.inverse())
        elif root is not None:
            yield Transform(_MAP, self.root, root)
        for joint in self._seen:
            parent = self._in_world(joint.parent, messages)
            child = body.in_world(joint.child, messages)
            if parent is not None and child is not None:
                yield self._of(joint.parent, joint.child, parent.inverse() @ child)

    def _in_world(self, link: str, messages: Messages) -> Pose | None:
        """Return the true pose of a link, by that of one that it is fixed to where it has none."""
        pose = self.body.in_world(link, messages)
        joint = self.body.model.robot.joint_above.get(link)
        if pose is not None or joint is None or joint.moves:
            return pose
        parent = self._in_world(joint.parent, messages)
        return None if parent is None else parent @ self.body.model.origins[joint.name]

    def _of(self, parent: str, child: str, pose: Pose) -> Transform:
        return Transform(self.frames[parent], self.frames[child], pose)


def _optical(link: str) -> str:
    """Return the optical frame of a camera's link; the plant's cameras have the same axes."""
    return link if link.endswith(_OPTICAL) else link + _OPTICAL[0]
