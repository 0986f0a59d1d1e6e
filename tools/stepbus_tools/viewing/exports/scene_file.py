"""The scene of a recording: in motion as one HTML file, and still at its end."""

import base64
import gzip
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from stepbus_orchestrator.recording import Recording
from stepbus_schemas import StepbusError
from stepbus_tools.report.summary import scenario_name
from stepbus_tools.viewing.door import branded, open_page
from stepbus_tools.viewing.exports.exporter import Exported, Reached
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.rasteriser import Painter, Pixels
from stepbus_tools.viewing.scene.build import drawn_scene
from stepbus_tools.viewing.stage.stage import Stage, add_floor
from stepbus_tools.viewing.viewpoint import framed, swept
from stepbus_tools.whole_file import replaced

_FRAMES_PER_S = 30.0
_MOST_FRAMES = 1800
_ASPECT = 1.6
_DARK = "{darkMode:matchMedia('(prefers-color-scheme: dark)').matches}"


def write(recording: Recording, target: Path, reached: Reached) -> Exported:
    """Write a recording's scene as one HTML file; its problems are what it does not show."""
    html, problems = scene_html(recording, reached)
    with replaced(target) as path:
        path.write_text(html, encoding="utf-8")
    return Exported(paths=[target], problems=problems)


def scene_html(recording: Recording, reached: Reached) -> tuple[str, Sequence[str]]:
    """Return a recording's scene as one page, and what it does not show.

    Raises RecordingFailed where there is no scene.
    """
    scene, history = drawn_scene(recording), History(recording)
    last = history.last_step
    # Thirty a second, fewer of a long recording.
    count = min(_MOST_FRAMES, round(history.end_ns * 1e-9 * _FRAMES_PER_S), last)
    times = history.times(max(1, count))
    name = scenario_name(recording)
    page = open_page(name)
    try:
        # The light is viser's: its player switches that on again whenever it starts anew.
        stage = Stage(page.server, scene, shade=lambda color: color)
        first = history.at(scene.topics, times[0])
        stage.move(scene.poses(first))
        shown, camera = swept(scene, history), page.server.initial_camera
        view = framed(shown.box, fixed=shown.fixed, aspect=_ASPECT, fov=camera.fov)
        camera.position, camera.look_at = view.eye, view.target
        add_floor(page.server.scene, *shown.box)
        serializer = page.server.get_scene_serializer()
        for before, t_ns in pairwise(times):
            serializer.insert_sleep((t_ns - before) * 1e-9)
            stage.move(scene.poses(history.at(scene.topics, t_ns)))
            reached(round(t_ns * last / max(times[-1], 1)))
        html = branded(serializer.as_html(), name)
        html = html.replace("{darkMode:false}", _DARK, 1)
    finally:
        page.close()
    return html, scene.notes


_SIZE = (720, 480)


def scene_at_end(recording: Recording) -> Pixels | None:
    """Return what a recording shows at its end, shape (480, 720, 4); None without a scene."""
    try:
        scene, history = drawn_scene(recording), History(recording)
    except (StepbusError, OSError, ValueError):
        return None
    messages = history.at(scene.topics, history.end_ns)
    painter = Painter(scene, _SIZE, smooth=True)
    shown = swept(scene, history)
    return painter.cut_out(messages, framed(shown.box, fixed=shown.fixed))


REPLAY_POLICY = (
    "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; font-src data:; "
    "script-src 'unsafe-inline' 'unsafe-eval' blob: data:; worker-src blob: data:; "
    "connect-src blob: data:; frame-src blob:; media-src blob: data:"
)
"""What the page may load: nothing that is not in it. A scene's page inherits it."""


def packed_replay(path: Path) -> str:
    """Return the page of a recording's scene, compressed, as base64.

    Raises RecordingFailed where it has no scene.
    """
    with Recording(path) as recording:
        html, _ = scene_html(recording, lambda _step: None)
    return base64.b64encode(gzip.compress(html.encode(), mtime=0)).decode()


def replay_html(packed: str) -> str:
    """Return what unfolds to the scene in motion."""
    if not packed:
        return ""
    return (
        '<details class="replay"><summary>The scene in motion</summary>'
        f'<script type="application/gzip">{packed}</script></details>'
    )
