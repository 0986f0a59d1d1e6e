"""What the mission does about an emergency stop: nothing until it is released, then it goes on."""

from stepbus_schemas import EmergencyStop
from stepbus_store.cause import Cause
from stepbus_store.mission.rest import rest_of
from stepbus_store.mission.state import Outcome, StoreState
from stepbus_store.mission.state_table import BESIDE, STATES


class Interruption:
    """Follows an emergency stop; is_over: it was not released in time."""

    def __init__(self) -> None:
        self._stop: EmergencyStop | None = None
        self.is_over = False

    @property
    def is_held(self) -> bool:
        """Return whether an emergency stop is in force."""
        return self._stop is not None

    def holds(self, store: StoreState, now: EmergencyStop | None) -> bool:
        """Return whether nothing may be commanded; report the stop, and its release."""
        was, self._stop = self._stop, now if now is not None and now.active else None
        if self._stop is None:
            return False
        if was is None:
            text = f"{self._stop}: nothing is commanded until it is released"
            store.log.append(("warning", text))
        longest = store.settings.waits.release
        if store.inputs.t_ns * 1e-9 - self._stop.since >= longest:
            text = f"{self._stop}, not released for {longest:g} s"
            store.record_problem(Outcome(name="failed", cause=Cause.EMERGENCY_STOP, text=text))
            store.rest = rest_of(store)
            self.is_over = True
        return True

    def resumes(self, store: StoreState, now: EmergencyStop | None) -> str:
        """Return the state to begin again at the step of a release, else nothing; call it first."""
        if self._stop is None or now is None or now.active:
            return ""
        # Beside a base that drives, it is sent off again; all others begin once more.
        state = BESIDE.get(store.visit.state, store.visit.state)
        took = now.since - self._stop.since
        text = f"emergency stop released by {now.by} after {took:.2f} s; goes on"
        store.log.append(("info", f"{text} {STATES[state].doing}"))
        return state
