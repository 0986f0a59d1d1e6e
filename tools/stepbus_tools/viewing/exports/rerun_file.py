"""A recording for Rerun: an .rrd with the scene in motion, curves, events and images.

The SDK writes the file and opens no connection; only its viewer, a program of its own, would count
its users, and `rerun analytics disable` forbids it.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Batch, Port, Recording
from stepbus_orchestrator.run.result import result_beside
from stepbus_participant import need
from stepbus_schemas import Event, Image, StepbusError
from stepbus_tools.columns import LISTS, Field, Table, pieces
from stepbus_tools.report.summary import scenario_name
from stepbus_tools.signals import Array
from stepbus_tools.viewing.exports.exporter import (
    Exported,
    Instant,
    Rate,
    Reached,
    instants,
    readable_ports,
)
from stepbus_tools.viewing.rasteriser import pixels_of
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.pose import Pose
from stepbus_tools.viewing.scene.scene import Frame, Latest, Scene
from stepbus_tools.whole_file import replaced

_NO_CURVES = ("Detections/1", "Goal/1", "Image/1", "Poses/1", "Transforms/1")
"""Types whose numbers are seen elsewhere, or make no curve."""
_QUALITY = 85
_DEPTH = "32FC1"
_PER_S = 30.0
"""Poses of the scene, and images of each camera, at most."""


def write(recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write the scene, the numbers of all ports, events and images."""
    ports, lost = readable_ports(recording)
    scene = build_scene(recording)
    wanted = [p for p in ports if p.type in ("Event/1", "Image/1") or p.topic in scene.topics]
    rate, latest = Rate(_PER_S), dict[str, Latest]()
    with replaced(target) as path:
        file = _Rrd(target, recording, scene)
        try:
            file.open(path)
            for shown in scene.frames:
                file.look(shown)
            for t_ns, group in instants(recording, wanted, lost, reached):
                moving = {i.port.topic: i for i in group if i.port.topic in scene.topics}
                latest |= {topic: Latest(i.step, i.message) for topic, i in moving.items()}
                if moving and rate.passes("", t_ns):
                    step = max(one.step for one in latest.values())
                    file.move(scene.world_poses(latest), step, t_ns)
                for instant in group:
                    # No event is left out.
                    if instant.port.type == "Event/1" or rate.passes(instant.port.topic, t_ns):
                        file.take(instant)
            lost |= file.curves(ports, lost)
            file.end()
        finally:
            file.close()
    return Exported(paths=[target], problems=[*scene.notes, *lost.values()], lost=list(lost))


class _Rrd:
    """The file, and where in it things are.

    Raises ExtraMissing without Rerun or Pillow.
    """

    _path: Path

    def __init__(self, target: Path, recording: Recording, scene: Scene) -> None:
        self._rr, self._reading = need("the export for Rerun", "rerun", "rerun.chunk")
        self._target = target
        self._recording = recording
        self._shown = {f.name for f in scene.frames if f.visuals and not f.is_ghost}
        self._newest: dict[str, Pose] = {}
        self._curves: set[str] = set()
        place = uuid.uuid5(uuid.NAMESPACE_URL, recording.path.resolve().as_uri())
        # Without properties, which would hold the time of the wall clock.
        self._stream = self._rr.RecordingStream(
            "stepbus", recording_id=place, send_properties=False
        )

    def open(self, path: Path) -> None:
        """Begin the file."""
        self._path = path
        try:
            self._stream.save(path)
        except RuntimeError as exc:
            raise RecordingFailed(f"{path} cannot be written: {exc}") from exc
        # Nothing in the file depends on the clock of the wall.
        self._rr.set_log_time_enabled(False, recording=self._stream)
        self._stream.send_recording_name(scenario_name(self._recording))
        z_up = self._rr.ViewCoordinates.RIGHT_HAND_Z_UP
        self._stream.log("world", z_up, static=True)

    def close(self) -> None:
        """Write what is left, and let the file go; raises RecordingFailed where that fails."""
        try:
            self._stream.flush()
            self._stream.disconnect()
            # What goes wrong at the very end, it does not say.
            self._reading.RrdReader(self._path).store()
        except (RuntimeError, ValueError) as exc:
            why = f"{self._target} cannot be written; is the disk full? ({exc})"
            raise RecordingFailed(why) from exc
        finally:
            self._stream.disconnect()

    def _world(self, name: str) -> str:
        return f"world/{self._rr.escape_entity_path_part(name)}"

    def look(self, frame: Frame) -> None:
        """Write what a frame looks like."""
        if frame.name not in self._shown:
            return
        for number, visual in enumerate(frame.visuals):
            points = visual.mesh.vertices[visual.mesh.faces].reshape(-1, 3)
            sides = points.reshape(-1, 3, 3)
            normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
            size = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
            place = f"{self._world(frame.name)}/visual_{number}"
            mesh = self._rr.Mesh3D(
                vertex_positions=points,
                triangle_indices=np.arange(len(points)).reshape(-1, 3),
                vertex_normals=np.repeat(normals / size, 3, axis=0),
                albedo_factor=visual.shown_color,
            )
            self._stream.log(place, mesh, _transform(self._rr, visual.pose), static=True)

    def move(self, poses: Mapping[str, Pose], step: int, t_ns: int) -> None:
        """Write where the frames are that look like something and have moved."""
        self._at(step, t_ns)
        for name in self._shown:
            if (pose := poses[name]) != self._newest.get(name):
                self._newest[name] = pose
                self._stream.log(self._world(name), _transform(self._rr, pose))

    def take(self, instant: Instant) -> None:
        """Write an event or an image; anything else is part of the scene."""
        match instant.message:
            case Event() as event:
                self._at(instant.step, instant.t_ns)
                word = {"warning": "WARN"}.get(event.level, event.level.upper())
                place = f"events/{instant.port.participant}"
                self._stream.log(place, self._rr.TextLog(event.text, level=word))
            case Image() as image if (shown := self._image(image)) is not None:
                self._at(instant.step, instant.t_ns)
                self._stream.log(instant.port.topic, shown)

    def _at(self, step: int, t_ns: int) -> None:
        self._stream.set_time("time", duration=np.timedelta64(t_ns, "ns"))
        self._stream.set_time("step", sequence=step)

    def _image(self, image: Image) -> Any:
        """Return a colour image as JPEG, a depth image as it is; None where its size is wrong."""
        try:
            if image.encoding == _DEPTH:
                meters = np.frombuffer(image.data, "<f4").reshape(image.height, image.width)
                return self._rr.DepthImage(meters, meter=1.0)
            return self._rr.Image(pixels_of(image)).compress(jpeg_quality=_QUALITY)
        except (ValueError, SystemError):
            return None

    def curves(self, ports: Sequence[Port], lost: Mapping[str, str]) -> dict[str, str]:
        """Write all numbers; return topic → why one is not whole, of those that were not lost."""
        tables = [Table(p) for p in ports if p.type not in _NO_CURVES and p.topic not in lost]
        failed: dict[str, str] = {}
        for table, batch in pieces(self._recording, tables, failed):
            topic, fields = table.port.topic, [f for f in table.fields if f.is_numeric]
            try:
                rows = list(table.numbers(batch, fields))
            except StepbusError as exc:
                failed[topic] = f"{topic}: {exc}"
                continue
            for field, numbers in rows:
                if numbers is not None and field.columns[0].type not in LISTS:
                    self._curve(table.port, field, batch, numbers)
        return failed

    def _curve(self, port: Port, field: Field, batch: Batch, numbers: Array) -> None:
        """Write a piece of one field, a curve for each of its names."""
        if not np.isfinite(numbers).any():
            return
        place = f"{port.topic}/{field.name}"
        if place not in self._curves:
            names = [column.name.removeprefix(f"{field.name}.") for column in field.columns]
            unit = field.columns[0].unit
            names = [f"{name} [{unit}]" for name in names] if unit not in {"", "-"} else names
            self._curves.add(place)
            self._stream.log(place, self._rr.SeriesLines(names=names), static=True)
        times = [
            self._rr.TimeColumn("time", duration=batch.t_ns.astype("timedelta64[ns]")),
            self._rr.TimeColumn("step", sequence=batch.steps),
        ]
        self._stream.send_columns(place, times, self._rr.Scalars.columns(scalars=numbers))

    def end(self) -> None:
        """Write how the run ended."""
        result = result_beside(self._recording)
        if result is not None and result.exit_code:
            self._at(max(result.at_step, 0), max(result.at_step, 0) * result.step_ns)
            self._stream.log("events/orchestrator", self._rr.TextLog(result.reason, level="ERROR"))


def _transform(rr: Any, pose: Pose) -> Any:
    w, x, y, z = pose.wxyz
    return rr.Transform3D(translation=pose.position, quaternion=(x, y, z, w))
