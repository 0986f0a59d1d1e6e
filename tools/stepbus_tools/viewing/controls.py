"""What a viewer can do to a run: pace it, and call what its participants offer."""

from collections.abc import Mapping
from typing import Any

from stepbus_orchestrator.recording import PortInfo
from stepbus_tools.viewing.run_client import Link
from stepbus_tools.viewing.stage import Stage
from stepbus_tools.viewing.steer_panel import Hands

SPEEDS: Mapping[str, float | None] = {
    "as fast as possible": None,
    "real time": 1.0,
    "half": 0.5,
    "a tenth": 0.1,
}

_HINT = "The run has not begun, or it runs in one process: it cannot be changed from here."
_REDONE = "Each change is recorded as a call with its step; `stepbus rerun` does it again."


class Controls:
    """Buttons of a page. link: to the run. ports: of its recording."""

    def __init__(self, server: Any, link: Link, ports: Mapping[str, PortInfo]) -> None:
        self._gui = server.gui
        self._server = server
        self._link = link
        self._ports = ports
        self._pause = self._gui.add_button("pause")
        self._pause.on_click(lambda _: self._toggle())
        step = self._gui.add_button("step")
        step.on_click(lambda _: link.ask("", "step", 1))
        self._speed = self._gui.add_dropdown(
            "speed", tuple(SPEEDS), initial_value=next(iter(SPEEDS))
        )
        self._speed.on_update(self._set_speed)
        self._table: Any = None
        self._speeds = dict(SPEEDS)
        self._has_hands = False

    def _set_speed(self, event: Any) -> None:
        # What this process sets has no client.
        if event.client_id is not None:
            self._link.ask("", "speed", self._speeds[self._speed.value])

    def _show_speed(self, status: Mapping[str, Any]) -> None:
        """Show how fast the run goes, also where it was started in real time or another set it."""
        limit, now = status.get("real_time"), status.get("speed")
        speeds = dict(SPEEDS)
        if limit is not None:
            slower = {name: value for name, value in SPEEDS.items() if value and value < limit}
            speeds = {_pace(limit): None, **slower}
        if now is not None and now not in speeds.values():
            speeds[_pace(now)] = now
        if speeds != self._speeds:
            self._speeds = speeds
            self._speed.options = tuple(speeds)
        shown = next(name for name, value in speeds.items() if value == now)
        if shown != self._speed.value:
            self._speed.value = shown

    def _toggle(self) -> None:
        is_paused = self._link.status.get("phase") == "paused"
        self._link.ask("", "resume" if is_paused else "pause")

    def add_tabs(self, tabs: Any, stage: Stage) -> None:
        """Add a tab about the participants, and one of what can be changed."""
        self.hands = Hands(self._server, self._link, self._ports, stage)
        self._change = tabs.add_tab("Steer")
        with self._change:
            self._hint = self._gui.add_markdown(_HINT)
        with tabs.add_tab("Timing"):
            self._table = self._gui.add_markdown("")
            stop = self._gui.add_button("end the run", color="gray")
            stop.on_click(lambda _: self._link.ask("", "stop"))

    def update(self) -> None:
        """Show what the run says of itself."""
        status = self._link.status
        if not status:
            return
        label = "resume" if status["phase"] == "paused" else "pause"
        if self._link.offered and not self._has_hands:
            self._has_hands = True
            with self._change:
                self.hands.offer(self._link.offered)
        if self._pause.label != label:
            self._pause.label = label
        self._show_speed(status)
        self.hands.update()
        if self._has_hands:
            self._hint.content = f"{_REDONE}  \n{self._link.last}"
        self._table.content = _participants(status)


def _pace(factor: float) -> str:
    return "real time" if factor == 1.0 else f"{factor:g} × real time"


def _participants(status: Mapping[str, Any]) -> str:
    rows = [
        f"| {name} | {'holds the step' if name in status['holders'] else phase} | "
        f"{_us(status['compute_us'], name)} | {_us(status['waited_us'], name)} | "
        f"{status['drops'].get(name, 0)} |"
        for name, phase in status["phases"].items()
    ]
    head = "| participant | state | computes [µs] | waits [µs] | dropped |\n|---|---|---|---|---|"
    return "\n".join([head, *rows])


def _us(values: Mapping[str, float], name: str) -> str:
    return f"{values[name]:.0f}" if name in values else ""
