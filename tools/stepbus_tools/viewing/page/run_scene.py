"""The scene of a run on its page: at its end, and in motion."""

import base64
import gzip
from pathlib import Path

from stepbus_orchestrator.recording import Recording
from stepbus_schemas import StepbusError
from stepbus_tools.viewing.exports.scene_file import scene_html
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.render import Painter, Pixels
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.swept import swept
from stepbus_tools.viewing.viewpoint import framed

_SIZE = (720, 480)


def scene_at_end(recording: Recording) -> Pixels | None:
    """Return what a recording shows at its end, shape (480, 720, 4); None without a scene."""
    try:
        scene, history = build_scene(recording), History(recording)
    except (StepbusError, OSError, ValueError):
        return None
    if history.last_step < 0 or not scene.has_looks:
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
