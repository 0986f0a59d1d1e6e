"""Emergency stops, and whether everything is at rest after one and at the end."""

import math

from stepbus_schemas import EmergencyStop
from stepbus_store.cause import Cause
from stepbus_store.mission.state import Outcome, StoreState
from stepbus_store.mission.state_table import BESIDE, STATES

NO_ANSWER = "the controller does not answer"

_LOST = (Cause.NO_ANSWER, Cause.NO_PERCEPTION, Cause.NO_PLAN, Cause.NO_POSE)
"""Causes after which a participant is missing: the run ends soon, and nothing may move then."""

_UPRIGHT = math.radians(8.0)
"""Tilt from which the base counts as overturned, or about to be."""

_AT_REST = 0.005
"""Velocity below which the base is at rest [m/s, rad/s]."""


def at_rest(store: StoreState) -> Outcome | None:
    """Wait until the arm is at rest and the base has been at rest for a while."""
    visit, waits, status = store.visit, store.settings.waits, store.inputs.status
    if _moves(store) or status is None or status.state != "succeeded":
        visit.since_ns = None
    elif visit.since_ns is None:
        visit.since_ns = store.inputs.t_ns
    if visit.since_ns is not None and store.since(visit.since_ns) >= waits.rest:
        tilted = f"all motors are at rest; {_tilted(store)}"
        store.rest = tilted if overturned(store) else "everything is at rest"
        cause = store.problem.cause if store.problem is not None else ""
        recovers = store.settings.recover and cause not in (*_LOST, Cause.ARM_JAMMED, Cause.TILTED)
        return Outcome(name="recover" if recovers else "rest")
    if store.elapsed < waits.halt:
        return None
    store.rest = f"not at rest after {waits.halt:g} s, {_restless(store)}"
    return Outcome(name="restless", cause=Cause.NOT_SETTLED, text=store.rest)


def overturned(store: StoreState) -> Outcome | None:
    """Return that the base is tilted more than it may be."""
    if store.tilt <= _UPRIGHT:
        return None
    return Outcome(name="failed", cause=Cause.TILTED, text=_tilted(store))


def _tilted(store: StoreState) -> str:
    return f"the robot is tilted by {math.degrees(store.tilt):.0f}°"


def rest_of(store: StoreState) -> str:
    """Return whether the base is at rest, where nothing is commanded to the arm."""
    is_restless = _moves(store) or overturned(store)
    return f"not at rest, {_restless(store)}" if is_restless else "everything is at rest"


def _moves(store: StoreState) -> bool:
    base = store.inputs.odometry
    return not max(abs(base.vx), abs(base.wz)) < _AT_REST


def _restless(store: StoreState) -> str:
    base, status = store.inputs.odometry, store.inputs.status
    if overturned(store) is not None:
        return _tilted(store)
    if _moves(store):
        return f"the base moves at {base.vx:.3f} m/s and {base.wz:.3f} rad/s"
    if status is None:
        return NO_ANSWER
    return f"the controller reports {status.state}" + (f", {status.text}" if status.text else "")


class Interruption:
    """Follows an emergency stop; stop: the one in force; is_over: it was not released in time."""

    def __init__(self) -> None:
        self.stop: EmergencyStop | None = None
        self.is_over = False

    def holds(self, store: StoreState) -> bool:
        """Return whether nothing may be commanded; report the stop."""
        now, was = store.inputs.stop, self.stop
        self.stop = now if now is not None and now.active else None
        if self.stop is None:
            return False
        if was is None:
            text = "nothing is commanded until it is released"
            store.log.append(("warning", f"{self.stop}: {text}"))
        longest = store.settings.waits.release
        if store.inputs.t_ns * 1e-9 - self.stop.since >= longest:
            text = f"{self.stop}, not released for {longest:g} s"
            store.record_problem(Outcome(name="failed", cause=Cause.EMERGENCY_STOP, text=text))
            store.rest = rest_of(store)
            self.is_over = True
        return True

    def resumes(self, store: StoreState) -> str:
        """Return the state to begin again at the step of a release, else nothing; call it first."""
        now = store.inputs.stop
        if self.stop is None or now is None or now.active:
            return ""
        # Beside a base that drives, it is sent off again; all others begin once more.
        state = BESIDE.get(store.visit.state, store.visit.state)
        took = now.since - self.stop.since
        text = f"emergency stop released by {now.by} after {took:.2f} s; goes on"
        store.log.append(("info", f"{text} {STATES[state].doing}"))
        return state
