"""From a recording's descriptions and files to its scene."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import PortInfo, Recording, Tail, layout
from stepbus_orchestrator.replay.sources import Sources
from stepbus_participant import scratch_folder
from stepbus_schemas import parse_shapes
from stepbus_tools.viewing.scene.pose import from_xyzw
from stepbus_tools.viewing.scene.scene import Body, JointSource

from .meshes import GREY, PLACEHOLDER, Color, Visual, primitive
from .model import is_moved_by
from .origin import Origin
from .scene import GHOST, BodyMotion, Chain, Frame, LinkMotion, Scene

Ports = Mapping[str, PortInfo]


_TRUTH = "body"
"""Detail that only the plant's poses have."""
_MEASURED = ("JointState/1", "GripperState/1")
_WANTED = ("JointReference/1", "JointCommand/1")


def build_scene(source: Recording | Tail) -> Scene:
    """Return the scene of a recording, from its own descriptions and files.

    Meshes are those of the model packages that are installed here; where one is missing, a box
    stands for it, and a note says so.
    """
    origin = Origin()
    if layout.SCENARIO_ATTACHMENT in source.attachments:
        with tempfile.TemporaryDirectory(prefix="stepbus-scene-", dir=scratch_folder()) as folder:
            try:
                sources = Sources.of(source)
                origin = Origin(sources.unpack(Path(folder) / "source"))
            except RecordingFailed as exc:
                origin.notes.append(str(exc))
    else:
        text = f"{source.path.name} contains no scenario: showing only its messages"
        origin.notes.append(text)
    return _Builder(origin, source.ports).build()


def drawn_scene(recording: Recording) -> Scene:
    """Return the scene of a recording; raises RecordingFailed where there is nothing to draw."""
    scene, is_empty = build_scene(recording), recording.last_whole_step < 0
    if is_empty or not scene.has_looks:
        why = "it has no messages" if is_empty else scene.notes[-1]
        raise RecordingFailed(f"{recording.path} has no scene to show: {why}")
    return scene


@dataclass(frozen=True)
class _Link:
    """A link in descriptions of poses. ports: topic → its number there."""

    name: str
    body: str
    type: str
    shape: str
    color: str
    ports: dict[str, int]


class _Builder:
    def __init__(self, origin: Origin, ports: Ports) -> None:
        self._origin = origin
        self._ports = ports
        self._notes = origin.notes
        self._frames: list[Frame] = []
        self._motions: list[BodyMotion] = []
        self._links = self._read_links()
        self._bodies = [self._with_ports(body) for body in origin.bodies]

    def build(self) -> Scene:
        placed = {name for body in self._bodies for name in self._add_body(body)}
        known = {body.name for body in self._bodies}
        for name, link in self._links.items():
            if link.body not in known:
                # A body without a model of its own may have that of its type.
                model = self._origin.types.get(link.type)
                look = model.links.get(model.root, ()) if model else tuple(self._shapes(link))
                self._frames.append(Frame(name=name, visuals=look, body=link.body))
                placed.add(name)
        if not any(frame.visuals for frame in self._frames):
            self._notes.append("it has no model and no shapes to draw; showing curves only")
        links = {
            port.topic: [name if name in placed else None for name in port.names]
            for port in self._true_poses()
        }
        return Scene(
            frames=self._frames,
            motions=[LinkMotion(links), *self._motions],
            chains=list(self._chains()),
            notes=list(dict.fromkeys(self._notes)),
            bodies=self._bodies,
        )

    def _of_type(self, name: str) -> list[PortInfo]:
        return [port for port in self._ports.values() if port.type == name]

    # --- links with recorded poses --------------------------------------------------------

    def _true_poses(self) -> Iterator[PortInfo]:
        for port in self._of_type("Poses/1"):
            if _TRUTH in port.description.details:
                yield port

    def _read_links(self) -> dict[str, _Link]:
        links: dict[str, _Link] = {}
        for port in self._true_poses():
            details = port.description.details
            rows = [details.get(key) or () for key in (_TRUTH, "type", "shape", "color")]
            for number, name in enumerate(port.names):
                body, kind, shape, color = (
                    row[number] if number < len(row) else "" for row in rows
                )
                link = _Link(name, body, kind, shape, color, {})
                links.setdefault(name, link).ports[port.topic] = number
        return links

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
            pose = from_xyzw(shape.position, shape.orientation)
            yield Visual(mesh=mesh or PLACEHOLDER, pose=pose, color=_color(link.color))

    # --- bodies with a model --------------------------------------------------------------

    def _with_ports(self, body: Body) -> Body:
        """Return a body with the ports that know where it is."""
        prefix = f"{body.name}/"
        links = {
            link: row.ports
            for name, row in self._links.items()
            if row.body == body.name and (link := name.removeprefix(prefix)) in body.model.links
        }
        odometry = (p.topic for p in self._of_type("BaseState/1") if _joint_names(body, p))
        return replace(
            body,
            measured=self._sources(body, _MEASURED),
            links=links,
            odometry=next(odometry, ""),
        )

    def _add_body(self, body: Body) -> list[str]:
        """Add the frames of a body; returns those whose true poses are recorded."""
        seen = [name for name, visuals in body.model.links.items() if visuals]
        own = {
            link.name.removeprefix(f"{body.name}/"): link.name
            for link in self._links.values()
            if link.body == body.name
        }
        placed = [own[name] for name in seen if name in body.links]
        if body.links and len(placed) == len(seen):
            for name in seen:
                pose, visuals = body.start @ body.model.pose(name, {}), body.model.links[name]
                frame = Frame(name=own[name], pose=pose, visuals=visuals, body=body.name)
                self._frames.append(frame)
        else:
            placed, own = [], {}
            self._add_tree(body, f"{body.name}/", body.measured)
        targets = self._sources(body, _WANTED)
        if targets:
            # The body once more, where its joints should be.
            sources = [*targets, *body.measured]
            real = {name: own.get(name, f"{body.name}/{name}") for name in body.model.links}
            self._add_tree(body, f"{GHOST}/{body.name}/", sources, real)
        return placed

    def _add_tree(
        self,
        body: Body,
        prefix: str,
        sources: Sequence[JointSource],
        real: Mapping[str, str] | None = None,
    ) -> None:
        """Add the frames of a body that its joints place.

        real: of a ghost, link → the frame that is where the link is.
        """
        model = body.model
        known = {name for source in sources for name in source.names}
        moving = [joint for joint in model.joints if is_moved_by(joint, known)]
        shown = {joint.child for joint in moving} if real else set(model.links)
        for joint in model.joints:
            # Parents first: what hangs on a link is shown with it.
            shown |= {joint.child} if joint.parent in shown else set()
        rows = [
            (model.root, "", body.start),
            *((j.child, prefix + j.parent, model.placed(j, {})) for j in model.joints),
        ]
        self._frames += [
            Frame(
                name=prefix + link,
                parent=parent,
                pose=pose,
                visuals=model.links.get(link, ()) if link in shown else (),
                body=body.name,
                ghost_of=(real or {}).get(link, ""),
            )
            for link, parent, pose in rows
        ]
        if moving or body.anchor or body.odometry:
            self._motions.append(BodyMotion(body, prefix, sources, moving))

    def _sources(self, body: Body, types: Sequence[str]) -> list[JointSource]:
        """Return the ports of some types that know joints of a body."""
        return [
            JointSource(topic=port.topic, names=names)
            for type_name in types
            for port in self._of_type(type_name)
            if (names := _joint_names(body, port)) and self._places(port)
        ]

    def _places(self, port: PortInfo) -> bool:
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
            for body in self._bodies:
                joints = {joint.name: joint for joint in body.model.joints if joint.moves}
                root = body.model.root
                name = next((n for n in (root, f"{body.name}/{root}") if n in frames), None)
                if port.names and joints.keys() >= set(port.names) and name is not None:
                    tip = joints[port.names[-1]].child
                    yield Chain(
                        topic=port.topic, names=port.names, model=body.model, root=name, tip=tip
                    )


def _joint_names(body: Body, port: PortInfo) -> list[str]:
    """Return a port's names as the body's model has them; none where it has none of them.

    The plant names a joint `body/joint` where bodies share its name.
    """
    joints = {joint.name for joint in body.model.joints if joint.moves}
    names = [name.removeprefix(f"{body.name}/") for name in port.names]
    return names if joints.intersection(names) else []


def _color(text: str) -> Color:
    try:
        red, green, blue = (min(255, max(0, round(255 * float(word)))) for word in text.split())
    except ValueError:
        return GREY
    return red, green, blue
