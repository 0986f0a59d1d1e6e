"""The goal that is carried out, and its parts."""

from dataclasses import dataclass

from stepbus_schemas import Goal, RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.avoidance import Avoidance
from stepbus_store.motion.back_to_rest import BackToRest
from stepbus_store.motion.beside_goals import Companion
from stepbus_store.motion.outcome import Measured, Outcome, Refused, Reports, failure_of
from stepbus_store.motion.parts import Part, Parts

_LATE = 1.02
"""Share of the requested duration from which a motion counts as slower."""


@dataclass(kw_only=True)
class Active:
    """A goal under way; arm_rests: of a `stop` goal."""

    goal: Goal
    part: Part
    is_reported: bool = False
    arm_rests: bool = False


class UnderWay:
    """Starts and ends the motions of goals, and reports how each goal ends.

    active: the goal under way; driving: that of the base, while `active` moves beside it.
    companion: what lets an arm move beside the base. stopped_beside: a goal that ends with that of
    the base, which backs off. lost_planner: why there are no plans any more; empty: there are.
    """

    def __init__(self, parts: Parts, reports: Reports, avoidance: Avoidance) -> None:
        self.parts = parts
        self.reports = reports
        self.avoidance = avoidance
        self.active: Active | None = None
        self.driving: Active | None = None
        self.companion: Companion | None = None
        self.returning: BackToRest | None = None
        self.stopped_beside: Active | None = None
        self.lost_planner = ""

    def move(self, goal: Goal, part: Part, now: Measured | None, t: float) -> str:
        """Start the motion of a goal and return what is reported of it; raises RunError."""
        if now is None:
            raise RunError("nothing has been measured yet")
        if part != "all":
            self.check_planner()
        held = self.avoidance.held
        if goal.type == "back_to_rest":
            arm = self.parts.arm
            self.returning = BackToRest(goal=goal, held=held, arm=arm, tip=arm.tip)
            return self.returning.start(now, t)
        return self.parts.start(part, goal, now, t, held)

    def check_planner(self) -> None:
        """Raise Refused where there are no plans any more."""
        if self.lost_planner:
            raise Refused(Cause.NO_PLAN, self.lost_planner)

    def rest(self, t: float, *, touches: bool = False) -> None:
        """Bring to rest what the goal under way has set in motion."""
        if self.active is not None:
            self.parts.rest(self.active.part, t, touches=touches)

    def cancel(self, old: Active, by: Goal) -> None:
        """Report that a new goal has taken the place of another one."""
        text = f"goal {by.id} came before it was done"
        self.reports.status(old.goal.id, "cancelled", text=text)

    def report_end(self, ended: Active, outcome: Outcome) -> None:
        """Report how a goal has ended."""
        self.reports.status(ended.goal.id, outcome.state, outcome.cause, outcome.text)

    def fail(self, active: Active, error: RunError, t: float) -> None:
        """End the goal under way by an error, and bring it to rest."""
        self.rest(t)
        self.end(active, failure_of(error))

    def end(self, active: Active, outcome: Outcome) -> None:
        """End the goal under way; that of the base continues."""
        if outcome.state == "succeeded" and active.part == "arm":
            outcome = self._timed(active.goal, outcome)
        self.report_end(active, outcome)
        if self.companion is not None:
            self.companion.leave(is_done=outcome.state == "succeeded")
        self.active, self.driving, self.companion = self.driving, None, None
        self.returning = None
        beside, self.stopped_beside = self.stopped_beside, None
        if beside is not None:
            self.report_end(beside, outcome)
        if self.active is not None:
            self.avoidance.join(self.active.goal, self.active.part)

    def _timed(self, goal: Goal, outcome: Outcome) -> Outcome:
        """Return a success that names how much longer than requested it took."""
        took = self.parts.arm.took
        if took is None or goal.duration == 0.0 or took <= goal.duration * _LATE + 0.02:
            return outcome
        text = f"took {took:.2f} s instead of {goal.duration:.2f} s; {outcome.text}"
        return Outcome(state="succeeded", cause=Cause.SLOWER, text=text)
