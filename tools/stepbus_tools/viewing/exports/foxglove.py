"""A recording for Foxglove and Lichtblick: foxglove.* messages at 30 Hz."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording
from stepbus_participant import need
from stepbus_tools.viewing.exports.exporter import Exported, Exporter, Reached
from stepbus_tools.viewing.foxglove_conversion import SHOWN, Conversion
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.whole_file import replaced

from .instants import readable_ports, thinned


def _export(recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write joints, the scene and its frames, images and events."""
    ports, lost = readable_ports(recording)
    scene = build_scene(recording)
    wanted = [p for p in ports if p.type in SHOWN or p.topic in scene.topics]
    with replaced(target) as path, _opened(path, target) as log:
        conversion = Conversion(scene, log)
        conversion.place({frame.name: frame.pose for frame in scene.frames}, 0)
        conversion.bodies()
        for t_ns, moved, group in thinned(recording, scene, wanted, lost, reached):
            if moved:
                conversion.place(scene.poses(moved), t_ns)
            for instant in group:
                conversion.take(instant.port, instant.message, t_ns)
    problems = [*scene.notes, *lost.values()]
    return Exported(paths=[target], problems=problems, lost=list(lost))


FOXGLOVE = Exporter(write=_export, help="an .mcap for Foxglove and Lichtblick, at 30 Hz")


@contextmanager
def _opened(path: Path, target: Path) -> Iterator[Any]:
    """Open a file, and yield what writes a message of a topic at a time [ns] into it.

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
    except BaseException:
        with suppress(RuntimeError):
            writer.close()
        raise
    try:
        writer.close()
    except RuntimeError as exc:
        raise RecordingFailed(f"{target} cannot be written; is the disk full? ({exc})") from exc
