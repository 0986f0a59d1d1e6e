"""A recording for Foxglove and Lichtblick: foxglove.* messages at 30 Hz, and a layout."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording
from stepbus_participant import need
from stepbus_tools.viewing.exports.export_files import Exported, Reached
from stepbus_tools.viewing.foxglove_conversion import PER_S, SHOWN, Conversion, topic_of
from stepbus_tools.viewing.foxglove_layout import layout_of
from stepbus_tools.whole_file import replaced

from .moments import NS, Moving, Rate, instants, readable


def export_foxglove(recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write joints, the scene and its frames, images and events; and a layout beside it.

    The layout has the name of the target, with the ending .layout.json.

    Raises RecordingFailed when nothing can be exported or a file cannot be written, ExtraMissing
    without the library.
    """
    foxglove, channels = need("the export for Foxglove", "foxglove", "foxglove.channels")
    lost: dict[str, str] = {}
    ports = readable(recording, lost)
    moving = Moving(recording, round(NS / PER_S))
    problems = list(moving.scene.notes)
    wanted = [p for p in ports if p.type in SHOWN or p.topic in moving.scene.topics]
    layout = target.with_suffix(".layout.json")
    rate = Rate(PER_S)
    with replaced(target) as path:
        context = foxglove.Context()
        with _opened(foxglove, path, target, context):
            conversion = Conversion(moving.scene, _Channels(channels, context).log)
            conversion.place(moving.still(), 0)
            conversion.bodies()
            for t_ns, group in instants(recording, wanted, lost, reached):
                placed = moving.take(t_ns, group)
                if placed:
                    conversion.place(placed, t_ns)
                for moment in group:
                    is_event = moment.port.type == "Event/1"
                    if is_event or rate.passes(topic_of(moment.port), t_ns):
                        conversion.take(moment.port, moment.message, t_ns)
    with replaced(layout) as path:
        text = json.dumps(layout_of(moving.scene, moving.latest, wanted), indent=2)
        path.write_text(text + "\n", encoding="utf-8")
    problems += lost.values()
    return Exported(paths=[target, layout], problems=problems, lost=list(lost))


@contextmanager
def _opened(foxglove: Any, path: Path, target: Path, context: Any) -> Iterator[None]:
    """Open a file for what is logged; the library says at its end whether it could be written."""
    writer = foxglove.open_mcap(path, allow_overwrite=True, context=context)
    try:
        yield
    except BaseException:
        with suppress(RuntimeError):
            writer.close()
        raise
    try:
        writer.close()
    except RuntimeError as exc:
        raise RecordingFailed(f"{target} cannot be written; is the disk full? ({exc})") from exc


class _Channels:
    """The channels of the file, each opened when its first message comes."""

    def __init__(self, channels: Any, context: Any) -> None:
        self._channels = channels
        self._context = context
        self._opened: dict[str, Any] = {}

    def log(self, topic: str, message: Any, t_ns: int) -> None:
        """Write a message. t_ns: [ns]."""
        if topic not in self._opened:
            channel = getattr(self._channels, f"{type(message).__name__}Channel")
            self._opened[topic] = channel(topic, context=self._context)
        self._opened[topic].log(message, log_time=t_ns)
