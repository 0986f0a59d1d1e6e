"""The scene of a run on its page: at its end, what stands in its world, and in motion."""

import base64
import gzip
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import StepbusError
from stepbus_tools.viewing.exports.scene_file import scene_html
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.render import Painter, Pixels
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.swept import swept
from stepbus_tools.viewing.viewpoint import framed

from .plan import outlines

_SIZE = (720, 480)


@dataclass(frozen=True, kw_only=True)
class SceneAtEnd:
    """What a recording shows at its end.

    still: shape (480, 720, 4), without a background. things: outlines of what stands in the world
    [m], from above.
    """

    still: Pixels
    things: Sequence[Array]


def scene_at_end(recording: Recording) -> SceneAtEnd | None:
    """Return what a recording shows at its end; None where it has no scene."""
    try:
        scene, history = build_scene(recording), History(recording)
    except (StepbusError, OSError, ValueError):
        return None
    if history.last_step < 0 or not scene.has_looks:
        return None
    messages = history.at(scene.topics, history.end_ns)
    painter = Painter(scene, _SIZE, smooth=True)
    shown = swept(scene, history)
    still = painter.cut_out(messages, framed(shown.box, fixed=shown.fixed))
    return SceneAtEnd(still=still, things=outlines(scene, messages))


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
