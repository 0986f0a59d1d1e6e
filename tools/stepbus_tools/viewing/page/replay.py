"""The scene of a run in motion, packed into its page: unpacked when somebody opens it."""

import base64
import gzip
from pathlib import Path

from stepbus_orchestrator.recording import Recording
from stepbus_tools.viewing.exports.scene_file import scene_html

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
