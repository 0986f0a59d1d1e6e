"""The frames of a recording as ROS has them (REP 105): map → odom → base → links → cameras."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

from stepbus_orchestrator.recording import Port
from stepbus_tools.viewing.scene import (
    Frame,
    Joint,
    Messages,
    Modelled,
    Pose,
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

    A frame has the name of its link. That of a robot begins with the robot's name and a slash where
    there are several robots; that of another body where the link's name is taken.
    """

    def __init__(self, scene: Scene, ports: Sequence[Port]) -> None:
        robots = [body for body in scene.bodies if body.model.has_joints]
        others = [body for body in scene.bodies if not body.model.has_joints]
        known = {body.name for body in scene.bodies}
        self._scene = scene
        self._loose = [f for f in scene.frames if f.body not in known and not f.is_ghost]
        taken = Counter([MAP, _ODOM, *(frame.name for frame in self._loose)])
        taken.update(link for body in scene.bodies for link in body.model.links)
        is_only = len(robots) == 1 and robots[0].model.links.keys().isdisjoint((MAP, _ODOM))
        self._robots = [BodyTree(body, "" if is_only else f"{body.name}/") for body in robots]
        self._trees = [*self._robots, *(BodyTree(body, "", taken) for body in others)]
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

    @property
    def robots(self) -> "Sequence[BodyTree]":
        """Return the bodies with joints, each with its own frames."""
        return self._robots

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
        for tree in self._robots:
            if tree.body.odometry == port.topic:
                return tree.odom, tree.root
        mobile = [tree.root for tree in self._robots if tree.body.odometry]
        return MAP, mobile[0] if len(mobile) == 1 else ""

    def still(self) -> Iterator[Transform]:
        """Yield the frames that never move."""
        yield from chain.from_iterable(tree.still() for tree in self._trees)
        for link in dict.fromkeys(self._cameras.values()):
            if optical(link) != link:
                yield Transform(parent=link, child=optical(link), pose=Pose())

    def moved(self, topics: frozenset[str], messages: Messages) -> Iterator[Transform]:
        """Yield the frames that the newest messages of some ports place."""
        poses: dict[str, Pose] = {}
        for motion in self._scene.motions:
            if not motion.topics.isdisjoint(topics):
                poses |= motion.poses(messages)
        for frame in self._loose:
            if frame.name in poses:
                yield _of_frame(frame, poses[frame.name])
        for tree in self._trees:
            yield from tree.moved(topics, messages)


class BodyTree:
    """The frames of one body.

    prefix: of their names. taken: how many links and frames have a name; one that is not alone
    begins with the name of the body.
    """

    def __init__(self, body: Modelled, prefix: str, taken: Mapping[str, int] = {}) -> None:
        self.body = body
        self.prefix = prefix
        self.frames = {
            link: f"{body.name}/{link}" if taken.get(link, 0) > 1 else prefix + link
            for link in body.model.links
        }
        self.root = self.frames[body.model.root]
        self.odom = prefix + _ODOM
        known: set[str] = set()
        self._measured: dict[str, list[Joint]] = {}
        for source in body.sources:
            names = set(source.names) - known
            self._measured[source.topic] = self._moved_by(names)
            known |= {joint.name for joint in self._measured[source.topic]}
        joints = [joint for joint in body.model.joints if joint.name not in known]
        self._seen = [joint for joint in joints if joint.moves and joint.child in body.links]
        self._still = [joint for joint in joints if joint not in self._seen]
        self._truth = frozenset(chain.from_iterable(body.links.values()))

    def _moved_by(self, names: set[str]) -> list[Joint]:
        return [
            joint
            for joint in self.body.model.joints
            if joint.moves and (joint.name in names or (joint.mimic or ("",))[0] in names)
        ]

    def still(self) -> Iterator[Transform]:
        """Yield the joints that never move, and the root where nothing moves it."""
        body = self.body
        for joint in self._still:
            yield self._joint(joint, joint.at(body.model.position(joint, {})))
        if body.odometry:
            if not body.anchor:
                yield Transform(parent=MAP, child=self.odom, pose=body.start)
        elif body.is_fixed or not body.anchor:
            yield Transform(parent=MAP, child=self.root, pose=body.start)

    def moved(self, topics: frozenset[str], messages: Messages) -> Iterator[Transform]:
        """Yield what the newest messages of some ports place."""
        body = self.body
        positions = all_positions(body.sources, messages)
        for topic in sorted(topics & self._measured.keys()):
            for joint in self._measured[topic]:
                yield self._joint(joint, joint.at(body.model.position(joint, positions)))
        if body.odometry in topics and (pose := body.root_in_odom(messages)) is not None:
            yield Transform(parent=self.odom, child=self.root, pose=pose)
        if not topics.isdisjoint(self._truth):
            yield from self._by_truth(messages)

    def _by_truth(self, messages: Messages) -> Iterator[Transform]:
        """Yield map → odom, or → the root; and the joints that nothing else measures."""
        body = self.body
        root = None if body.is_fixed else body.root_in_world(messages)
        if root is not None and body.odometry:
            in_odom = body.root_in_odom(messages) or Pose()
            yield Transform(parent=MAP, child=self.odom, pose=root @ in_odom.inverse())
        elif root is not None:
            yield Transform(parent=MAP, child=self.root, pose=root)
        for joint in self._seen:
            parent = self._in_world(joint.parent, messages)
            child = body.in_world(joint.child, messages)
            if parent is not None and child is not None:
                yield self._joint(joint, parent.inverse() @ child)

    def _in_world(self, link: str, messages: Messages) -> Pose | None:
        """Return the true pose of a link, by that of one that it is fixed to where it has none."""
        pose = self.body.in_world(link, messages)
        joint = self.body.model.above.get(link)
        if pose is not None or joint is None or joint.moves:
            return pose
        parent = self._in_world(joint.parent, messages)
        return None if parent is None else parent @ joint.origin

    def _joint(self, joint: Joint, pose: Pose) -> Transform:
        return Transform(
            parent=self.frames[joint.parent], child=self.frames[joint.child], pose=pose
        )


def optical(link: str) -> str:
    """Return the optical frame of a camera's link; the plant's cameras have the same axes."""
    return link if link.endswith(_OPTICAL) else link + _OPTICAL[0]


def _of_frame(frame: Frame, pose: Pose) -> Transform:
    return Transform(parent=frame.parent or MAP, child=frame.name, pose=pose)
