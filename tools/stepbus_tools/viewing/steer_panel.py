"""The last half minute of every port, so that a curve is there as soon as it is picked."""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from stepbus_orchestrator.recording import PortInfo, Tail
from stepbus_schemas import JointState
from stepbus_tools.viewing.run_client import Link
from stepbus_tools.viewing.scene import Messages
from stepbus_tools.viewing.stage import Stage
from stepbus_tools.viewing.stage.stage_curves import Data, Signal, value_of

_POINTS = 900
"""Of a curve: half a minute."""
_BYTES = 2 * 1024 * 1024
"""Of a port: a type of the user's own may be large."""


class Points:
    """Keeps the newest messages of some ports, one a frame, and reads a signal from them.

    step_ns: returns the length of a step [ns]; 0 while nobody knows it.
    """

    def __init__(self, tail: Tail, topics: Iterable[str], step_ns: Callable[[], int]) -> None:
        self._tail = tail
        self._step_ns = step_ns
        self._kept: dict[str, deque[tuple[int, bytes]]] = {topic: deque() for topic in topics}
        self._picked: Signal | None = None
        self._rows: deque[tuple[int, list[float]]] = deque(maxlen=_POINTS)

    def add(self) -> None:
        """Keep what is new."""
        for topic, kept in self._kept.items():
            newest = self._tail.newest(topic)
            if newest is not None and (not kept or newest[0] > kept[-1][0]):
                kept.append(newest)
                while len(kept) > max(2, min(_POINTS, _BYTES // (len(newest[1]) + 1))):
                    kept.popleft()

    def sample(self, signal: Signal) -> Data:
        """Return a signal before now: times up to 0, shape (T,) [s], and values, shape (T, n)."""
        if signal != self._picked:
            self._picked = signal
            self._rows.clear()
        last = self._rows[-1][0] if self._rows else -1
        for step, data in self._kept.get(signal.topic, ()):
            message = self._tail.decode(signal.topic, data) if step > last else None
            if message is not None:
                self._rows.append((step, value_of(signal, message)))
        steps = np.array([step for step, _ in self._rows], dtype=np.float64)
        values = np.array([row for _, row in self._rows], dtype=np.float64)
        seconds = (steps - steps[-1:].sum()) * (self._step_ns() or 1_000_000_000) * 1e-9
        return seconds, values.reshape(len(steps), len(signal.names))


_TARGET = "set_target"
_TELEPORT = "set_joint_position"
_MOVE = "move_body"
_STOP = "emergency_stop"
_ORDER = "order"
_MOVE_S = 0.5
"""How long a joint takes to a new target [s]."""
_NOBODY = "(none)"
_TOUCHED_S = 3.0
"""For so long a slider shows what was asked for, then what is measured."""
_MOST_JOINTS = 40

Offered = Mapping[str, Mapping[str, Any]]


class Hands:
    """Sliders of joints, a handle at a body, orders, and emergency stop, where calls offer them."""

    def __init__(self, server: Any, link: Link, ports: Mapping[str, PortInfo], stage: Stage):
        self._server = server
        self._gui = server.gui
        self._link = link
        self._ports = ports
        self._stage = stage
        self._scene = scene = stage.scene
        self._bodies = {frame.body: frame.name for frame in reversed(scene.frames) if frame.body}
        self._handle: Any = None
        self._messages: Messages = {}
        self._sliders: dict[str, Any] = {}
        self._touched: dict[str, float] = {}

    def offer(self, offered: Offered) -> None:
        """Add what the participants of a run offer; call it once, in a tab."""
        for name in _who(offered, _STOP):
            stop = self._gui.add_button(f"emergency stop ({name})", color="red")
            stop.on_click(lambda _, who=name: self._link.ask(who, _STOP, True))
            free = self._gui.add_button("release", color="gray")
            free.on_click(lambda _, who=name: self._link.ask(who, _STOP, False))
        for name in _who(offered, _ORDER):
            self._add_order(name)
        for name in _who(offered, _MOVE):
            self._add_bodies(name)
        self._add_joints(offered)

    # --- joints ---------------------------------------------------------------------------

    def _add_joints(self, offered: Offered) -> None:
        """Add a slider for each measured joint that a call can send somewhere."""
        method = _TARGET if _who(offered, _TARGET) else _TELEPORT
        who = next(iter(_who(offered, method)), None)
        if who is None:
            return
        self._gui.add_markdown(f"joint targets [rad], by `{who} {method}`")
        for joint, low, high in list(_limits(self._ports))[:_MOST_JOINTS]:
            now = min(max(self._measured().get(joint, 0.0), low), high)
            slider = self._gui.add_slider(joint, min=low, max=high, step=0.001, initial_value=now)
            slider.on_update(self._sender(who, method, joint, slider))
            self._sliders[joint] = slider

    def _sender(self, who: str, method: str, joint: str, slider: Any) -> Callable[[Any], None]:
        more = [_MOVE_S] if method == _TARGET else []

        def send(event: Any) -> None:
            if event.client_id is not None:
                self._touched[joint] = time.monotonic()
                self._link.ask(who, method, joint, float(slider.value), *more)

        return send

    def _measured(self) -> dict[str, float]:
        """Return joint → its newest measured position."""
        positions: dict[str, float] = {}
        for port in self._ports.values():
            latest = self._messages.get(port.topic)
            if latest is not None and isinstance(latest.message, JointState):
                positions |= dict(zip(port.names, latest.message.position or (), strict=False))
        return positions

    def update(self) -> None:
        """Let each slider that nobody has touched for a while show where its joint is."""
        now, measured = time.monotonic(), self._measured()
        for joint, slider in self._sliders.items():
            if now - self._touched.get(joint, -_TOUCHED_S) >= _TOUCHED_S and joint in measured:
                position = round(min(max(measured[joint], slider.min), slider.max), 3)
                if position != slider.value:
                    slider.value = position

    # --- orders ---------------------------------------------------------------------------

    def _add_order(self, who: str) -> None:
        types = sorted(
            {
                kind
                for port in self._ports.values()
                for kind in port.description.details.get("type", ())
                if kind and port.type == "Poses/1"
            }
        )
        if not types:
            return
        choice = self._gui.add_dropdown("order", tuple(types), initial_value=types[0])
        button = self._gui.add_button("order it")
        button.on_click(lambda _: self._link.ask(who, _ORDER, choice.value))

    # --- bodies ---------------------------------------------------------------------------

    def _add_bodies(self, who: str) -> None:
        if not self._bodies:
            return
        names = (_NOBODY, *sorted(self._bodies))
        choice = self._gui.add_dropdown("move", names, initial_value=_NOBODY)
        self._choice = choice
        button = self._gui.add_button("put it there")
        choice.on_update(lambda _: self._take(choice.value))
        button.on_click(lambda _: self._put(who, choice.value))
        self._stage.on_click(self._choose)

    def _choose(self, body: str) -> None:
        """Take a body that was clicked at."""
        if body in self._bodies and body != self._choice.value:
            self._choice.value = body

    def _take(self, body: str) -> None:
        """Put a handle where a body is."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        if body in self._bodies:
            pose = self._scene.world_poses(self._messages)[self._bodies[body]]
            self._handle = self._server.scene.add_transform_controls(
                "/handle", scale=0.4, depth_test=False, position=pose.position, wxyz=pose.wxyz
            )

    def _put(self, who: str, body: str) -> None:
        if self._handle is None:
            return
        x, y, z = (round(float(value), 4) for value in self._handle.position)
        w, qx, qy, qz = (float(value) for value in self._handle.wxyz)
        yaw = math.atan2(2 * (w * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
        self._link.ask(who, _MOVE, body, x, y, z, round(yaw, 4))

    def follow(self, messages: Messages) -> None:
        """Know where things are."""
        self._messages = messages


def _who(offered: Offered, method: str) -> Sequence[str]:
    return [name for name, methods in offered.items() if method in methods]


def _limits(ports: Mapping[str, PortInfo]) -> Iterator[tuple[str, float, float]]:
    """Yield each measured joint with its limits; a turn where it has none."""
    seen = set()
    for port in ports.values():
        if port.type != "JointState/1":
            continue
        lower, upper = (port.description.limits.get(key, []) for key in ("lower", "upper"))
        for number, joint in enumerate(port.names):
            low = lower[number] if number < len(lower) else -math.inf
            high = upper[number] if number < len(upper) else math.inf
            if joint not in seen:
                seen.add(joint)
                yield joint, max(low, -math.pi), min(high, math.pi)
