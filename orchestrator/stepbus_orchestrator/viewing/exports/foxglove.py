"""A recording for Foxglove and Lichtblick: foxglove.* messages at 30 Hz, and a layout."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_orchestrator.recording import Port, Recording
from stepbus_orchestrator.viewing.render import pixels_of
from stepbus_orchestrator.viewing.scene import Frame, Pose
from stepbus_participant import need
from stepbus_schemas import Event, Image, JointReference, JointState

from .files import Exported, replaced
from .moments import NS, Moment, Moving, Rate, moments, readable
from .progress import Reached

PER_S = 30.0
_WORLD = "world"
_SHOWN = ("Event/1", "Image/1", "JointReference/1", "JointState/1")


def export_foxglove(recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write joints, the scene and its frames, images and events; and a layout beside it.

    The layout has the name of the target, with the ending .layout.json.

    Raises RecordingFailed when nothing can be exported or a file cannot be written, ExtraMissing
    without the library.
    """
    foxglove, channels, types, pillow = need(
        "the export for Foxglove", "foxglove", "foxglove.channels", "foxglove.messages", "PIL.Image"
    )
    problems: list[str] = []
    ports = readable(recording, problems)
    moving = Moving(recording, round(NS / PER_S))
    problems += moving.scene.notes
    wanted = [p for p in ports if p.type in _SHOWN or p.topic in moving.scene.topics]
    layout = target.with_suffix(".layout.json")
    with replaced(target) as path:
        context = foxglove.Context()
        with foxglove.open_mcap(path, allow_overwrite=True, context=context):
            view = _View(channels, types, pillow, context)
            view.place(moving, moving.still(), 0)
            view.bodies([frame for frame in moving.scene.frames if not frame.is_ghost])
            for moment in moments(recording, wanted, problems, reached):
                placed = moving.take(moment)
                if placed:
                    view.place(moving, placed, moment.t_ns)
                view.take(moment)
    with replaced(layout) as path:
        path.write_text(json.dumps(_layout(wanted), indent=2) + "\n", encoding="utf-8")
    return Exported(paths=[target, layout], problems=problems)


class _View:
    """The channels of the file, each opened when its first message comes."""

    def __init__(self, channels: Any, types: Any, pillow: Any, context: Any) -> None:
        self._channels, self._types, self._pillow = channels, types, pillow
        self._context = context
        self._opened: dict[str, Any] = {}
        self._rate = Rate(PER_S)
        self._writers: Mapping[type, Callable[[Moment], None]] = {
            JointState: self._joints,
            JointReference: self._joints,
            Image: self._image,
            Event: self._event,
        }

    def take(self, moment: Moment) -> None:
        """Write a message, as far as it is shown and due."""
        write = self._writers.get(type(moment.message))
        topic = _topic(moment.port)
        if write and (isinstance(moment.message, Event) or self._rate.passes(topic, moment.t_ns)):
            write(moment)

    def place(self, moving: Moving, placed: Mapping[str, Pose], t_ns: int) -> None:
        """Write where frames are in their parents."""
        types = self._types
        parents = {frame.name: frame.parent for frame in moving.scene.frames}
        rows = [
            types.FrameTransform(
                timestamp=self._stamp(t_ns),
                parent_frame_id=parents[name] or _WORLD,
                child_frame_id=name,
                translation=_vector(types, pose),
                rotation=_quaternion(types, pose),
            )
            for name, pose in placed.items()
        ]
        self._log("/tf", "FrameTransforms", types.FrameTransforms(transforms=rows), t_ns)

    def bodies(self, frames: list[Frame]) -> None:
        """Write what the frames look like; they keep their looks and move with their frames."""
        entities = [
            self._types.SceneEntity(
                timestamp=self._stamp(0),
                frame_id=frame.name,
                id=frame.name,
                frame_locked=True,
                triangles=[self._triangles(visual) for visual in frame.visuals],
            )
            for frame in frames
            if frame.visuals
        ]
        self._log("/scene", "SceneUpdate", self._types.SceneUpdate(entities=entities), 0)

    def _triangles(self, visual: Any) -> Any:
        types = self._types
        red, green, blue = (float(value) / 255 for value in visual.shown_color)
        points = visual.mesh.vertices.astype(float).tolist()
        return types.TriangleListPrimitive(
            pose=types.Pose(
                position=_vector(types, visual.pose), orientation=_quaternion(types, visual.pose)
            ),
            points=[types.Point3(x=x, y=y, z=z) for x, y, z in points],
            color=types.Color(r=red, g=green, b=blue, a=1.0),
            indices=visual.mesh.faces.ravel().tolist(),
        )

    def _joints(self, moment: Moment) -> None:
        state = moment.message
        columns = {name: getattr(state, name, None) for name in ("position", "velocity", "effort")}
        rows = [
            self._types.JointState(
                name=name,
                **{key: row[i] for key, row in columns.items() if row is not None and i < len(row)},
            )
            for i, name in enumerate(moment.port.names)
        ]
        message = self._types.JointStates(timestamp=self._stamp(moment.t_ns), joints=rows)
        self._log(_topic(moment.port), "JointStates", message, moment.t_ns)

    def _image(self, moment: Moment) -> None:
        if not isinstance(moment.message, Image):
            return
        stream = io.BytesIO()
        try:
            pixels = np.ascontiguousarray(pixels_of(moment.message))
            self._pillow.fromarray(pixels).save(stream, "JPEG", quality=85)
        except (ValueError, SystemError):
            return
        message = self._types.CompressedImage(
            timestamp=self._stamp(moment.t_ns),
            frame_id=f"{moment.port.participant}/{moment.port.name}",
            data=stream.getvalue(),
            format="jpeg",
        )
        self._log(_topic(moment.port), "CompressedImage", message, moment.t_ns)

    def _event(self, moment: Moment) -> None:
        if isinstance(moment.message, Event):
            level = getattr(self._types.LogLevel, moment.message.level.capitalize())
            message = self._types.Log(
                timestamp=self._stamp(moment.t_ns),
                level=level,
                message=moment.message.text,
                name=moment.port.participant,
            )
            self._log("/log", "Log", message, moment.t_ns)

    def _log(self, topic: str, type_name: str, message: Any, t_ns: int) -> None:
        if topic not in self._opened:
            kind = getattr(self._channels, f"{type_name}Channel")
            self._opened[topic] = kind(topic, context=self._context)
        self._opened[topic].log(message, log_time=t_ns)

    def _stamp(self, t_ns: int) -> Any:
        return self._types.Timestamp(sec=t_ns // NS, nsec=t_ns % NS)


def _topic(port: Port) -> str:
    return f"/{port.participant}/{port.name}"


def _vector(types: Any, pose: Pose) -> Any:
    x, y, z = pose.position
    return types.Vector3(x=x, y=y, z=z)


def _quaternion(types: Any, pose: Pose) -> Any:
    w, x, y, z = pose.wxyz
    return types.Quaternion(x=x, y=y, z=z, w=w)


def _layout(ports: list[Port]) -> Mapping[str, Any]:
    """Return a layout: the scene beside the joints' positions, the images, the log."""
    joints = [port for port in ports if port.type == "JointState/1"]
    images = [port for port in ports if port.type == "Image/1"]
    paths = [
        {"value": f"{_topic(port)}.joints[{index}].position", "label": name, "enabled": True}
        for port in joints
        for index, name in enumerate(port.names)
    ]
    panels: dict[str, Mapping[str, Any]] = {
        "3D!scene": {
            "followTf": _WORLD,
            "topics": {"/scene": {"visible": True}},
            "transforms": {},
            "scene": {"transforms": {"visible": False}},
        }
    }
    right: list[str] = []
    if paths:
        panels["Plot!joints"] = {"paths": paths[:20], "title": "position [rad]", "showLegend": True}
        right.append("Plot!joints")
    if images:
        panels["Image!camera"] = {"imageMode": {"imageTopic": _topic(images[0])}}
        right.append("Image!camera")
    panels["RosOut!log"] = {"topicToRender": "/log"}
    right.append("RosOut!log")
    column: Any = right[-1]
    for name in reversed(right[:-1]):
        column = {"direction": "column", "first": name, "second": column}
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row", "first": "3D!scene", "second": column, "splitPercentage": 60,
        },
    }  # fmt: skip
