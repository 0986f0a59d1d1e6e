"""What a visitor changes in a run: joints, bodies and orders."""

import math
import time
from collections.abc import Iterator, Mapping
from typing import Any

from stepbus_schemas import JointState
from stepbus_tools.columns import limits_of
from stepbus_tools.viewing.push_handle import PUSH, PushHandle
from stepbus_tools.viewing.run_client import RunClient
from stepbus_tools.viewing.scene.build import Ports
from stepbus_tools.viewing.scene.scene import Messages
from stepbus_tools.viewing.stage.stage import Stage

_TARGET = "set_target"
_TELEPORT = "set_joint_position"
_MOVE = "move_body"
_ORDER = "order"
_MOVE_S = 0.5
"""How long a joint takes to a new target [s]."""
_NO_BODY = "(none)"
_TOUCHED_S = 3.0
"""For so long a slider shows what was asked for, then what is measured."""
_MOST_JOINTS = 40

Offered = Mapping[str, Mapping[str, Any]]


class SteerPanel:
    """Sliders of joints, handles at a body and a link, and orders, where calls offer them."""

    def __init__(self, server: Any, client: RunClient, ports: Ports, stage: Stage) -> None:
        self._server = server
        self._gui = server.gui
        self._client = client
        self._ports = ports
        self._stage = stage
        frames = reversed(stage.scene.frames)
        self._bodies = {frame.body: frame.name for frame in frames if frame.body}
        self._handle: Any = None
        self._push: PushHandle | None = None
        self._messages: Messages = {}
        self._sliders: dict[str, Any] = {}
        self._touched: dict[str, float] = {}

    def offer(self, offered: Offered) -> None:
        """Add what the participants of a run offer; call it once, in a tab."""
        for name in offering(offered, _ORDER):
            self._add_order(name)
        for name in offering(offered, _MOVE):
            self._add_bodies(name)
        for name in offering(offered, PUSH):
            self._push = PushHandle(self._server, self._client, self._stage, name)
            self._push.follow(self._messages)
        self._add_joints(offered)

    def follow(self, messages: Messages) -> None:
        """Take what is measured now."""
        self._messages = messages
        if self._push is not None:
            self._push.follow(messages)

    # --- joints ---------------------------------------------------------------------------

    def _add_joints(self, offered: Offered) -> None:
        """Add a slider for each measured joint that a call can send somewhere."""
        method = _TARGET if offering(offered, _TARGET) else _TELEPORT
        who = next(iter(offering(offered, method)), None)
        if who is None:
            return
        self._gui.add_markdown(f"joint targets [rad], by `{who} {method}`")
        for joint, low, high in list(_limits(self._ports))[:_MOST_JOINTS]:
            now = min(max(self._measured().get(joint, 0.0), low), high)
            slider = self._gui.add_slider(joint, min=low, max=high, step=0.001, initial_value=now)
            slider.on_update(lambda event, name=joint: self._send(event, who, method, name))
            self._sliders[joint] = slider

    def _send(self, event: Any, who: str, method: str, joint: str) -> None:
        # What this process sets has no client.
        if event.client_id is not None:
            self._touched[joint] = time.monotonic()
            more = [_MOVE_S] if method == _TARGET else []
            self._client.ask(who, method, joint, float(self._sliders[joint].value), *more)

    def _measured(self) -> dict[str, float]:
        """Return joint → its newest measured position."""
        positions: dict[str, float] = {}
        for port in self._ports.values():
            latest = self._messages.get(port.topic)
            if latest is not None and isinstance(latest.message, JointState):
                positions |= dict(zip(port.names, latest.message.position or (), strict=False))
        return positions

    def update(self) -> None:
        """Show where its joint is on each slider that the user has not touched for a while."""
        now, measured = time.monotonic(), self._measured()
        for joint, slider in self._sliders.items():
            if now - self._touched.get(joint, -_TOUCHED_S) >= _TOUCHED_S and joint in measured:
                position = round(min(max(measured[joint], slider.min), slider.max), 3)
                if position != slider.value:
                    slider.value = position

    # --- orders ---------------------------------------------------------------------------

    def _add_order(self, who: str) -> None:
        poses = (port for port in self._ports.values() if port.type == "Poses/1")
        kinds = {kind for port in poses for kind in port.description.details.get("type", ())}
        if types := sorted(kinds - {""}):
            choice = self._gui.add_dropdown("order", tuple(types), initial_value=types[0])
            button = self._gui.add_button("place order", icon="shopping-cart")
            button.on_click(lambda _: self._client.ask(who, _ORDER, choice.value))

    # --- bodies ---------------------------------------------------------------------------

    def _add_bodies(self, who: str) -> None:
        if not self._bodies:
            return
        names = (_NO_BODY, *sorted(self._bodies))
        choice = self._gui.add_dropdown("move", names, initial_value=_NO_BODY)
        button = self._gui.add_button("place", icon="map-pin", disabled=True)

        def hold() -> None:
            self._hold(choice.value)
            button.disabled = self._handle is None

        choice.on_update(lambda _: hold())
        button.on_click(lambda _: self._put(who, choice.value))

        def choose(body: str) -> None:
            if body != choice.value:
                choice.value = body

        self._stage.on_click(choose)

    def _hold(self, body: str) -> None:
        """Put a handle where a body is."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        if body in self._bodies:
            pose = self._stage.scene.world_poses(self._messages)[self._bodies[body]]
            self._handle = self._server.scene.add_transform_controls(
                "/handle", scale=0.4, depth_test=False, position=pose.position, wxyz=pose.wxyz
            )

    def _put(self, who: str, body: str) -> None:
        """Ask for a body to be where its handle is."""
        if self._handle is not None:
            x, y, z = (round(float(value), 4) for value in self._handle.position)
            w, qx, qy, qz = (float(value) for value in self._handle.wxyz)
            yaw = math.atan2(2 * (w * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
            self._client.ask(who, _MOVE, body, x, y, z, round(yaw, 4))


def offering(offered: Offered, method: str) -> list[str]:
    """Return the participants that offer a method."""
    return [name for name, methods in offered.items() if method in methods]


def _limits(ports: Ports) -> Iterator[tuple[str, float, float]]:
    """Yield each measured joint with its limits; a turn where it has none."""
    seen = set()
    for port in ports.values():
        if port.type != "JointState/1":
            continue
        for number, joint in enumerate(port.names):
            low, high = limits_of(port.description.limits, "position", number)
            if joint not in seen:
                seen.add(joint)
                yield joint, max(low, -math.pi), min(high, math.pi)
