"""The scene of a run at its end: a picture of it, and what stands in its world."""

from collections.abc import Sequence
from dataclasses import dataclass

from stepbus_orchestrator.analysis.signals import Array
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import StepbusError
from stepbus_tools.viewing.history import History
from stepbus_tools.viewing.render import Painter, Pixels
from stepbus_tools.viewing.scene.build import build_scene
from stepbus_tools.viewing.scene.swept import swept
from stepbus_tools.viewing.viewpoint import framed

from .plan import outlines

_SIZE = (720, 480)


@dataclass(frozen=True, kw_only=True)
class SceneAtEnd:
    """still: shape (480, 720, 3). things: outlines of what stands in the world [m], from above."""

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
    still = painter.draw(messages, framed(swept(scene, history)))
    return SceneAtEnd(still=still, things=outlines(scene, messages))
