"""One picture of a recording's scene."""

from stepbus_orchestrator.recording import Recording

from .render import Painter, Pixels, whole_scene
from .scene import build_scene
from .scene_file import latest_messages

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
