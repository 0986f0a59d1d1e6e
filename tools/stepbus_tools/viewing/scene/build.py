"""From a recording's descriptions and files to its scene."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import layout
from stepbus_orchestrator.replay.rerun import attached_files, unpack_files
from stepbus_participant import scratch_folder
from stepbus_schemas import Description, parse_shapes
from stepbus_tools.viewing.scene.primitives import Pose

from .meshes import GREY, Color, Visual, primitive
from .model import Joint, Model
from .motions import (
    JointMotion,
    JointSource,
    LinkMotion,
    Modelled,
    Reader,
    RootMotion,
    measured,
    wanted,
)
from .origin import Body, Origin, has_scenario, read_origin
from .scene import GHOST, Chain, Frame, Motion, Scene

_IDENTITY = Pose()
_TRUTH = "body"
"""Detail that only the plant's poses have."""


class DescribedPort(Protocol):
    """A port, as a recording or a live run describes it."""

    @property
    def topic(self) -> str:
        """Return `participant/port`."""

    @property
    def type(self) -> str:
        """Return its type, `Name/major`."""

    @property
    def description(self) -> Description:
        """Return what its participant says of it."""

    @property
    def names(self) -> Sequence[str]:
        """Return the names that its vectors belong to."""


Ports = Mapping[str, DescribedPort]


def build_scene(path: Path, ports: Ports, attachments: Mapping[str, bytes]) -> Scene:
    """Return the scene of a recording, from its own descriptions and files.

    path: of the recording. Meshes are those of the model packages that are installed here; where
    one is missing, a box stands for it, and a note says so.
    """
    origin, notes = Origin(), list[str]()
    if has_scenario(attachments):
        with tempfile.TemporaryDirectory(prefix="stepbus-scene-", dir=scratch_folder()) as folder:
            try:
                scenario, files = attached_files(path, attachments)
                root = unpack_files(scenario, files, Path(folder) / "source")
                origin = read_origin(root)
            except RecordingFailed as exc:
                notes.append(str(exc))
    else:
        notes.append(f"{path.name} holds no scenario: only what its messages say is shown")
    return _Builder(origin, ports, [*notes, *origin.notes]).build()


@dataclass(frozen=True, kw_only=True)
class _Link:
    """A link in descriptions of poses. ports: topic → its number there."""

    name: str
    body: str
    type: str
    shape: str
    color: str
    ports: dict[str, int] = field(default_factory=dict)


class _Builder:
    def __init__(self, origin: Origin, ports: Ports, notes: list[str]) -> None:
        self._origin = origin
        self._ports = ports
        self._notes = notes
        self._frames: list[Frame] = []
        self._motions: list[Motion] = []
        self._links = self._read_links()
        self._placed: dict[str, str] = {}

    def build(self) -> Scene:
        bodies = list(self._origin.bodies)
        for body in bodies:
            self._add_body(body)
        known = {body.name for body in bodies}
        for link in self._links.values():
            if link.body not in known:
                self._add_link(link, self._look(link))
        self._motions.insert(0, LinkMotion(ports=self._columns()))
        if not any(frame.visuals for frame in self._frames):
            self._notes.append("it has nothing to draw: no model and no shapes; curves are shown")
        return Scene(
            frames=self._frames,
            motions=self._motions,
            chains=list(self._chains()),
            notes=list(dict.fromkeys(self._notes)),
            bodies=[self._modelled(body) for body in bodies],
        )

    # --- links with recorded poses --------------------------------------------------------

    def _read_links(self) -> dict[str, _Link]:
        links: dict[str, _Link] = {}
        for port in self._of_type("Poses/1"):
            details = port.description.details
            if _TRUTH not in details:
                continue
            for number, name in enumerate(port.names):
                body, kind, shape, color = (_item(details.get(k), number) for k in _KEYS)
                made = _Link(name=name, body=body, type=kind, shape=shape, color=color)
                link = links.setdefault(name, made)
                link.ports[port.topic] = number
        return links

    def _add_link(self, link: _Link, visuals: tuple[Visual, ...], pose: Pose = _IDENTITY) -> None:
        frame = Frame(name=link.name, pose=pose, visuals=visuals, label=link.type, body=link.body)
        self._frames.append(frame)
        self._placed[link.name] = link.name

    def _look(self, link: _Link) -> tuple[Visual, ...]:
        """Return what a link without a model of its body looks like."""
        model = self._origin.types.get(link.type)
        if model is not None:
            return model.links.get(model.root, ())
        return tuple(self._shapes(link))

    def _shapes(self, link: _Link) -> Iterator[Visual]:
        try:
            shapes = parse_shapes(link.shape)
        except ValueError as exc:
            self._notes.append(f"link {link.name}: {exc}")
            return
        for shape in shapes:
            mesh = primitive(shape.type, shape.sizes)
            if mesh is None:
                self._notes.append(f"link {link.name}: its {shape.type} is not recorded")
                mesh = primitive("box", (0.08, 0.08, 0.08))
            if mesh is not None:
                x, y, z, w = shape.orientation
                yield Visual(
                    mesh=mesh, pose=Pose(shape.position, (w, x, y, z)), color=_color(link.color)
                )

    def _columns(self) -> dict[str, list[str | None]]:
        """Return the frames that each port of poses places, in its order."""
        return {
            port.topic: [self._placed.get(name) for name in port.names]
            for port in self._of_type("Poses/1")
            if _TRUTH in port.description.details
        }

    # --- bodies with a model --------------------------------------------------------------

    def _add_body(self, body: Body) -> None:
        links = self._links_of(body)
        seen = [name for name, visuals in body.model.links.items() if visuals]
        if links and all(name in links for name in seen):
            for name in seen:
                pose = body.pose @ body.model.pose(name, {})
                visuals = body.model.links[name]
                self._add_link(links[name], visuals, pose)
        else:
            self._add_tree(body, f"{body.name}/", self._sources(body, measured))
        self._add_ghost(body)

    def _links_of(self, body: Body) -> dict[str, _Link]:
        """Return link of the model → its row in descriptions of poses."""
        prefix = f"{body.name}/"
        return {
            name.removeprefix(prefix): link
            for name, link in self._links.items()
            if link.body == body.name and name.removeprefix(prefix) in body.model.links
        }

    def _add_tree(
        self,
        body: Body,
        prefix: str,
        sources: Sequence[JointSource],
        *,
        is_ghost: bool = False,
    ) -> None:
        model = body.model
        known = {name for source in sources for name in source.names}
        moving = [joint for joint in model.joints if _is_moved(joint, known)]
        base = Frame(name="", body=body.name, is_ghost=is_ghost)

        shown = _below(model, moving) if is_ghost else set(model.links)

        def frame(link: str, parent: str, pose: Pose) -> Frame:
            visuals = model.links.get(link, ()) if link in shown else ()
            return replace(base, name=prefix + link, parent=parent, pose=pose, visuals=visuals)

        self._frames.append(frame(model.root, "", body.pose))
        rest: dict[str, float] = {}
        for joint in model.joints:
            pose = joint.at(model.position(joint, rest))
            self._frames.append(frame(joint.child, prefix + joint.parent, pose))
        if moving:
            motion = JointMotion(model=model, prefix=prefix, sources=sources, joints=moving)
            self._motions.append(motion)
        modelled = self._modelled(body)
        if modelled.anchor or modelled.odometry:
            self._motions.append(RootMotion(frame=prefix + model.root, body=modelled))

    def _modelled(self, body: Body) -> Modelled:
        return Modelled(
            name=body.name,
            model=body.model,
            start=body.pose,
            is_fixed=body.is_fixed,
            sources=self._sources(body, measured),
            links={name: link.ports for name, link in self._links_of(body).items()},
            odometry=self._odometry(body),
        )

    def _add_ghost(self, body: Body) -> None:
        """Add the body once more, where its joints should be."""
        targets = self._sources(body, wanted)
        if targets:
            sources = [*targets, *self._sources(body, measured)]
            prefix = f"{GHOST}/{body.name}/"
            self._add_tree(body, prefix, sources, is_ghost=True)

    def _sources(self, body: Body, read: Reader) -> list[JointSource]:
        """Return the ports that know joints of a body, by what reads them."""
        types = _MEASURED if read is measured else _WANTED
        return [
            JointSource(topic=port.topic, names=names, read=read)
            for type_name in types
            for port in self._of_type(type_name)
            if (names := _joint_names(body, port)) and self._places(port)
        ]

    def _places(self, port: DescribedPort) -> bool:
        """Return whether a port says where joints are; a command of torques does not."""
        return port.type != "JointCommand/1" or any(
            "position" in other.description.details.get("mode", ())
            for other in self._of_type("JointState/1")
            if set(other.names) & set(port.names)
        )

    def _chains(self) -> Iterator[Chain]:
        """Yield the joints of ports that carry planned paths."""
        frames = {frame.name for frame in self._frames}
        for port in self._of_type("Plan/1"):
            for body in self._origin.bodies:
                joints = {joint.name: joint for joint in body.model.joints if joint.moves}
                root = body.model.root
                name = next((n for n in (root, f"{body.name}/{root}") if n in frames), None)
                if port.names and joints.keys() >= set(port.names) and name is not None:
                    tip = joints[port.names[-1]].child
                    yield Chain(
                        topic=port.topic, names=port.names, model=body.model, root=name, tip=tip
                    )

    def _odometry(self, body: Body) -> str:
        ports = self._of_type("BaseState/1")
        return next((port.topic for port in ports if _joint_names(body, port)), "")

    def _of_type(self, name: str) -> list[DescribedPort]:
        return [port for port in self._ports.values() if port.type == name]


_KEYS = (_TRUTH, "type", "shape", "color")
_MEASURED = ("JointState/1", "GripperState/1")
_WANTED = ("JointReference/1", "JointCommand/1")


def _joint_names(body: Body, port: DescribedPort) -> list[str]:
    """Return a port's names as the body's model has them; none where it has none of them.

    The plant names a joint `body/joint` where bodies share its name.
    """
    joints = {joint.name for joint in body.model.joints if joint.moves}
    names = [name.removeprefix(f"{body.name}/") for name in port.names]
    return names if joints.intersection(names) else []


def _is_moved(joint: Joint, known: set[str]) -> bool:
    leader = None if joint.mimic is None else joint.mimic[0]
    return joint.moves and (joint.name in known or leader in known)


def _below(model: Model, joints: Sequence[Joint]) -> set[str]:
    """Return the links that some joints move."""
    children = {joint.child for joint in joints}
    for joint in model.joints:
        if joint.parent in children:
            children.add(joint.child)
    return children


def _item(values: Sequence[str] | None, number: int) -> str:
    return values[number] if values is not None and number < len(values) else ""


def _color(text: str) -> Color:
    try:
        red, green, blue = (min(255, max(0, round(255 * float(word)))) for word in text.split())
    except ValueError:
        return GREY
    return red, green, blue


def recorded_topics(topics: Sequence[str]) -> list[str]:
    """Return the topics of participants, without those of stepbus itself."""
    own = (layout.CHAIN_TOPIC, layout.CALLS_TOPIC)
    return [topic for topic in topics if topic not in own]
