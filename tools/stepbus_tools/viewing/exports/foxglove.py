"""A recording for Foxglove and Lichtblick: foxglove.* messages at 30 Hz."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import PortInfo, Recording
from stepbus_participant import need
from stepbus_schemas import Event, Image, JointReference, JointState, Message
from stepbus_tools.viewing.exports.exporter import NS, Exported, Reached, readable_ports, thinned
from stepbus_tools.viewing.render import jpeg
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.pose import Pose
from stepbus_tools.viewing.scene.scene import Frame, Scene
from stepbus_tools.whole_file import replaced


def write(recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write joints, the scene and its frames, images and events."""
    ports, lost = readable_ports(recording)
    scene = build_scene(recording)
    wanted = [p for p in ports if p.type in SHOWN or p.topic in scene.topics]
    with replaced(target) as path, _opened(path, target) as log:
        conversion = _Conversion(scene, log)
        conversion.place({frame.name: frame.pose for frame in scene.frames}, 0)
        conversion.bodies()
        for t_ns, moved, group in thinned(recording, scene, wanted, lost, reached):
            if moved:
                conversion.place(scene.poses(moved), t_ns)
            for instant in group:
                conversion.take(instant.port, instant.message, t_ns)
    problems = [*scene.notes, *lost.values()]
    return Exported(paths=[target], problems=problems, lost=list(lost))


@contextmanager
def _opened(path: Path, target: Path) -> Iterator[Any]:
    """Open a file; yield a function that logs (topic, message, time [ns]) to it.

    The library says at its end whether it could be written.
    """
    foxglove, channels = need("the export for Foxglove", "foxglove", "foxglove.channels")
    context = foxglove.Context()
    writer = foxglove.open_mcap(path, allow_overwrite=True, context=context)
    opened: dict[str, Any] = {}

    def log(topic: str, message: Any, t_ns: int) -> None:
        if topic not in opened:
            channel = getattr(channels, f"{type(message).__name__}Channel")
            opened[topic] = channel(topic, context=context)
        opened[topic].log(message, log_time=t_ns)

    try:
        yield log
    finally:
        try:
            writer.close()
        except RuntimeError as exc:
            raise RecordingFailed(f"{target} cannot be written; is the disk full? ({exc})") from exc


SHOWN = ("Event/1", "Image/1", "JointReference/1", "JointState/1")
"""Types that are converted, beside those that move the scene."""


class _Conversion:
    """Converts a scene and messages.

    emit: takes a topic, its foxglove message and the time [ns]. Raises ExtraMissing without
    foxglove-sdk.
    """

    def __init__(self, scene: Scene, emit: Callable[[str, Any, int], None]) -> None:
        (self._types,) = need("Foxglove", "foxglove.messages")
        self._emit = emit
        self._frames = [frame for frame in scene.frames if not frame.is_ghost]
        self._parents = {frame.name: frame.parent for frame in self._frames}

    def take(self, port: PortInfo, message: Message, t_ns: int) -> None:
        """Convert a message; messages of other types are left out."""
        match message:
            case JointState() | JointReference():
                self._emit(f"/{port.topic}", self._joints(port, message, t_ns), t_ns)
            case Image():
                if (image := self._image(port, message, t_ns)) is not None:
                    self._emit(f"/{port.topic}", image, t_ns)
            case Event():
                self._emit("/log", self._log(port, message, t_ns), t_ns)

    def place(self, placed: Mapping[str, Pose], t_ns: int) -> None:
        """Convert where frames are in their parents; ghosts have no place."""
        types = self._types
        rows = [
            types.FrameTransform(
                timestamp=self._stamp(t_ns),
                parent_frame_id=self._parents[name] or "world",
                child_frame_id=name,
                translation=types.Vector3(**_xyz(pose)),
                rotation=types.Quaternion(**_xyzw(pose)),
            )
            for name, pose in placed.items()
            if name in self._parents
        ]
        self._emit("/tf", types.FrameTransforms(transforms=rows), t_ns)

    def bodies(self) -> None:
        """Convert what the frames look like; they keep their looks and move with their frames."""
        entities = [self._entity(frame) for frame in self._frames if frame.visuals]
        self._emit("/scene", self._types.SceneUpdate(entities=entities), 0)

    def _entity(self, frame: Frame) -> Any:
        return self._types.SceneEntity(
            timestamp=self._stamp(0),
            frame_id=frame.name,
            id=frame.name,
            frame_locked=True,
            triangles=[self._triangles(visual) for visual in frame.visuals],
        )

    def _triangles(self, visual: Any) -> Any:
        types = self._types
        red, green, blue = (float(value) / 255 for value in visual.shown_color)
        points = visual.mesh.vertices.astype(float).tolist()
        return types.TriangleListPrimitive(
            pose=types.Pose(
                position=types.Vector3(**_xyz(visual.pose)),
                orientation=types.Quaternion(**_xyzw(visual.pose)),
            ),
            points=[types.Point3(x=x, y=y, z=z) for x, y, z in points],
            color=types.Color(r=red, g=green, b=blue, a=1.0),
            indices=visual.mesh.faces.ravel().tolist(),
        )

    def _joints(self, port: PortInfo, state: Message, t_ns: int) -> Any:
        columns = {key: getattr(state, key, None) for key in ("position", "velocity", "effort")}
        rows = [
            self._types.JointState(
                name=name,
                **{key: row[i] for key, row in columns.items() if row is not None and i < len(row)},
            )
            for i, name in enumerate(port.names)
        ]
        return self._types.JointStates(timestamp=self._stamp(t_ns), joints=rows)

    def _image(self, port: PortInfo, image: Image, t_ns: int) -> Any:
        """Return an image as JPEG; None where its bytes do not fit its size."""
        data = jpeg(image)
        return data and self._types.CompressedImage(
            timestamp=self._stamp(t_ns), frame_id=port.topic, data=data, format="jpeg"
        )

    def _log(self, port: PortInfo, event: Event, t_ns: int) -> Any:
        return self._types.Log(
            timestamp=self._stamp(t_ns),
            level=getattr(self._types.LogLevel, event.level.capitalize()),
            message=event.text,
            name=port.participant,
        )

    def _stamp(self, t_ns: int) -> Any:
        return self._types.Timestamp(sec=t_ns // NS, nsec=t_ns % NS)


def _xyz(pose: Pose) -> dict[str, float]:
    return dict(zip("xyz", pose.position, strict=True))


def _xyzw(pose: Pose) -> dict[str, float]:
    return dict(zip("wxyz", pose.wxyz, strict=True))
