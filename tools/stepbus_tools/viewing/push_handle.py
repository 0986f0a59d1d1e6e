"""An arrow that a visitor of a live run drags from a link, to push it."""

from typing import Any

import numpy as np

from stepbus_tools.viewing.run_client import RunClient
from stepbus_tools.viewing.scene.scene import Messages
from stepbus_tools.viewing.stage.stage import Stage

PUSH = "push"
_NEWTONS_PER_METRE = 100.0
_NO_LINK = "(none)"
_COLOR = (20, 110, 230)
_NODE, _ARROW = "/push", "/push_arrow"


class PushHandle:
    """A handle at a link: it is pushed as far as the handle is dragged away, when let go.

    who: the participant that pushes.
    """

    def __init__(self, server: Any, client: RunClient, stage: Stage, who: str) -> None:
        self._scene, self._client, self._stage, self._who = server.scene, client, stage, who
        self._messages: Messages = {}
        self._handle: Any = None
        self._arrow: Any = None
        links = sorted(frame.name for frame in stage.scene.frames if not frame.is_ghost)
        names = (_NO_LINK, *links)
        self._choice = server.gui.add_dropdown(PUSH, names, initial_value=_NO_LINK)
        self._size = server.gui.add_number(
            "newtons per metre", _NEWTONS_PER_METRE, min=0.001, max=1e6
        )
        self._choice.on_update(lambda _: self._hold())

    def follow(self, messages: Messages) -> None:
        """Stay at the link, unless the handle is dragged."""
        self._messages = messages
        if self._handle is not None and self._arrow is None:
            self._handle.position = self._origin()

    def _origin(self) -> Any:
        """Return where the link is [m]."""
        return self._stage.scene.world_poses(self._messages)[self._choice.value].position

    def _hold(self) -> None:
        for node in (self._handle, self._arrow):
            if node is not None:
                node.remove()
        self._handle = self._arrow = None
        if self._choice.value != _NO_LINK:
            self._handle = self._scene.add_transform_controls(
                _NODE, scale=0.4, depth_test=False, disable_rotations=True, position=self._origin()
            )
            self._handle.on_update(self._dragged)

    # Viser keeps the order of coroutines only.
    async def _dragged(self, event: Any) -> None:
        """Draw the arrow; push when it is let go."""
        origin, tip = np.array(self._origin()), np.array(event.target.position)
        if event.phase != "end":
            self._arrow = self._scene.add_arrows(_ARROW, np.array([[origin, tip]]), _COLOR)
        elif self._arrow is not None:
            self._arrow.remove()
            self._arrow = None
            force = [round(float(x), 4) for x in (tip - origin) * self._size.value]
            more = {"point": [0, 0, 0]}
            self._client.ask(self._who, PUSH, self._choice.value, force, "100ms", more)
