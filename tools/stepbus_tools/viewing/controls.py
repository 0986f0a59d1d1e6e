"""What a viewer can do to a run: pace it, end it, and call what its participants offer."""

from collections.abc import Mapping
from typing import Any

from stepbus_tools.viewing.run_client import RunClient
from stepbus_tools.viewing.scene.build import Ports
from stepbus_tools.viewing.stage.recording_view import stop_banner
from stepbus_tools.viewing.stage.stage import Stage
from stepbus_tools.viewing.steer_panel import SteerPanel, offering

_SPEEDS: Mapping[str, float | None] = {
    "as fast as possible": None,
    "real time": 1.0,
    "half": 0.5,
    "a tenth": 0.1,
}
_STOP = "emergency_stop"
_PLAY, _PAUSE = "player-play-filled", "player-pause-filled"
_HINT = "The run has not started, or it runs in one process: you cannot change it here."
_REDONE = "Each change is recorded as a call with its step; `stepbus rerun` repeats it."
_HEAD = "| participant | state | computes [µs] | waits [µs] | dropped |\n|---|---|---|---|---|"


class Controls:
    """Buttons of a page. client: of the run. panel: what its participants offer."""

    def __init__(self, server: Any, client: RunClient) -> None:
        gui = server.gui
        self._server = server
        self._client = client
        self._banner = gui.add_html("")
        self._stop = gui.add_button("emergency stop", color="red", icon="hand-stop", visible=False)
        self._stop.on_click(lambda _: self._ask_stop(stops=True))
        self._release = gui.add_button("release", color="dark", icon="lock-open", visible=False)
        self._release.on_click(lambda _: self._ask_stop(stops=False))
        self._pause = gui.add_button("pause", icon=_PAUSE, hint="space", visible=False)
        self._pause.on_click(lambda _: self._toggle())
        self._step = gui.add_button("step", icon="player-track-next", hint="→", visible=False)
        self._step.on_click(lambda _: self._one_step())
        gui.add_command("pause or resume", hotkey="space").on_trigger(lambda _: self._toggle())
        gui.add_command("one step", hotkey="arrowright").on_trigger(lambda _: self._one_step())
        self._speeds = _SPEEDS
        self._speed = gui.add_dropdown(
            "speed", tuple(_SPEEDS), initial_value=next(iter(_SPEEDS)), visible=False
        )
        self._speed.on_update(self._set_speed)
        self._has_panel = False

    def add_tabs(self, tabs: Any, stage: Stage, ports: Ports) -> None:
        """Add a tab of what can be changed, and one about the participants."""
        gui = self._server.gui
        self.panel = SteerPanel(self._server, self._client, ports, stage)
        self._steer = tabs.add_tab("Steer")
        with self._steer:
            self._hint = gui.add_markdown(_HINT)
        with tabs.add_tab("Timing"):
            self._table = gui.add_markdown("no data from the participants yet")
            self._end = gui.add_button("end the run", color="dark", icon="x", visible=False)
            self._end.on_click(lambda _: self._client.ask("", "stop"))

    @property
    def _is_paused(self) -> bool:
        return bool(self._client.status.get("phase") == "paused")

    def _toggle(self) -> None:
        self._client.ask("", "resume" if self._is_paused else "pause")

    def _ask_stop(self, *, stops: bool) -> None:
        for who in offering(self._client.offered, _STOP):
            self._client.ask(who, _STOP, stops, "the user of the page")

    def _one_step(self) -> None:
        if self._is_paused:
            self._client.ask("", "step", 1)

    def _set_speed(self, event: Any) -> None:
        # What this process sets has no client.
        if event.client_id is not None:
            self._client.ask("", "speed", self._speeds[self._speed.value])

    def update(self, stopped: str) -> None:
        """Show what the run says of itself. stopped: who stopped its robot; empty: nobody."""
        banner = stop_banner(stopped)
        if banner != self._banner.content:
            self._banner.content = banner
        can_stop = bool(offering(self._client.offered, _STOP))
        self._stop.visible = can_stop and not stopped
        self._release.visible = can_stop and bool(stopped)
        status = self._client.status
        if not status:
            return
        is_paused = self._is_paused
        label = "resume" if is_paused else "pause"
        if self._pause.label != label:
            self._pause.label, self._pause.icon = label, _PLAY if is_paused else _PAUSE
        for control in (self._pause, self._step, self._speed, self._end):
            control.visible = True
        self._step.disabled = not is_paused
        if self._client.offered and not self._has_panel:
            self._has_panel = True
            with self._steer:
                self.panel.offer(self._client.offered)
        self._show_speed(status)
        self.panel.update()
        if self._has_panel:
            self._hint.content = f"{_REDONE}  \n{self._client.last}"
        self._table.content = "\n".join([_HEAD, *(_row(name, status) for name in status["phases"])])

    def end(self) -> None:
        """Take off what acts on the run, which has ended."""
        buttons = (self._pause, self._step, self._speed, self._end, self._stop, self._release)
        for control in buttons:
            control.visible = False

    def _show_speed(self, status: Mapping[str, Any]) -> None:
        """Show how fast the run goes, also where it was started in real time or another set it."""
        limit, now = status.get("real_time"), status.get("speed")
        speeds = dict(_SPEEDS)
        if limit is not None:
            slower = {name: value for name, value in speeds.items() if value and value < limit}
            speeds = {_pace(limit): None, **slower}
        if now is not None and now not in speeds.values():
            speeds[_pace(now)] = now
        if speeds != self._speeds:
            self._speeds = speeds
            self._speed.options = tuple(speeds)
        shown = next(name for name, value in speeds.items() if value == now)
        if shown != self._speed.value:
            self._speed.value = shown


def _pace(factor: float) -> str:
    return "real time" if factor == 1.0 else f"{factor:g} × real time"


def _row(name: str, status: Mapping[str, Any]) -> str:
    """Return a participant's row of a table in Markdown."""
    phase = status["phases"][name]
    state = "running" if phase == "stepping" else phase
    state = "holds the step" if name in status["holders"] else state
    computes, waits = (
        f"{status[key][name]:.0f}" if name in status[key] else ""
        for key in ("compute_us", "waited_us")
    )
    return f"| {name} | {state} | {computes} | {waits} | {status['drops'].get(name, 0)} |"
