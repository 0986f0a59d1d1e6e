"""A recording as one HTML file: its scene in motion, with a time slider, offline."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import MessageError
from stepbus_tools.viewing.exports.export_files import Exported
from stepbus_tools.viewing.render import Painter, Pixels, whole_scene
from stepbus_tools.viewing.scene import Latest, Messages, Scene, build_scene
from stepbus_tools.viewing.stage import Stage, open_page
from stepbus_tools.viewing.stage.camera import look_at
from stepbus_tools.whole_file import replaced

_FRAMES_PER_S = 30.0
_MOST_FRAMES = 1800
_DARK = "{darkMode:matchMedia('(prefers-color-scheme: dark)').matches}"


def latest_messages(recording: Recording, scene: Scene, t_ns: int) -> Messages:
    """Return the newest message of each port that moves a scene, at a time [ns]."""
    messages = {}
    for topic in scene.topics:
        try:
            row = recording[topic].latest(t_ns)
        except MessageError:
            continue
        if row is not None:
            messages[topic] = Latest(step=row[0], message=row[1])
    return messages


def export_scene(recording: Recording, target: Path, reached: Callable[[int], None]) -> Exported:
    """Write a recording's scene as one HTML file; its problems are what it does not show.

    reached: is told the step that is written. Raises RecordingFailed when there is nothing to
    show or the file cannot be written, ExtraMissing without viser.
    """
    scene = build_scene(recording.path, recording.ports, recording.attachments)
    last = recording.last_step
    if last < 0 or not any(frame.visuals for frame in scene.frames):
        why = "it has no messages" if last < 0 else scene.notes[-1]
        raise RecordingFailed(f"{recording.path} has no scene to show: {why}")
    times = frame_times(recording, last)
    page = open_page(recording.path.parent.name)
    try:
        stage = Stage(page.server, scene)
        stage.move(scene.poses(latest_messages(recording, scene, times[0])))
        look_at(page.server, scene, latest_messages(recording, scene, times[0]))
        serializer = page.server.get_scene_serializer()
        for before, t_ns in pairwise(times):
            serializer.insert_sleep((t_ns - before) * 1e-9)
            stage.move(scene.poses(latest_messages(recording, scene, t_ns)))
            reached(round(t_ns * last / max(times[-1], 1)))
        html: str = serializer.as_html().replace("{darkMode:false}", _DARK, 1)
    finally:
        page.close()
    with replaced(target) as path:
        path.write_text(html, encoding="utf-8")
    return Exported(paths=[target], problems=scene.notes)


def frame_times(recording: Recording, last: int) -> list[int]:
    """Return the times to draw [ns]: thirty a second, fewer of a long recording."""
    end_ns = max((row.t_ns for port in recording.ports.values() if (row := port.last)), default=0)
    count = max(1, min(_MOST_FRAMES, round(end_ns * 1e-9 * _FRAMES_PER_S), last))
    return [end_ns * number // count for number in range(count + 1)]


_SIZE = (480, 320)
_LATEST_NS = 2**63 - 1


def scene_still(recording: Recording) -> Pixels | None:
    """Return what a recording shows at its end, shape (320, 480, 3); None without a robot."""
    if recording.last_step < 0:
        return None
    scene = build_scene(recording.path, recording.ports, recording.attachments)
    if not any(frame.visuals for frame in scene.frames):
        return None
    messages = latest_messages(recording, scene, _LATEST_NS)
    return Painter(scene, _SIZE, smooth=True).draw(messages, whole_scene(scene, messages))
