"""Carries out one goal at a time, and reports what becomes of it."""

from dataclasses import dataclass

from stepbus_motion.collisions.monitor import Collision, CollisionMonitor
from stepbus_motion.outcome import Outcome, Refused
from stepbus_schemas import Goal, RunError

from .avoidance import Avoidance, AvoidanceSettings
from .measured import Measured
from .parts import PART_OF, Part, Parts
from .reports import Reports

_LATE = 1.02
"""Share of the requested duration from which a motion counts as slower."""


@dataclass(kw_only=True)
class _Active:
    """The goal under way; arm_rests: of a `stop` goal."""

    goal: Goal
    part: Part
    is_reported: bool = False
    arm_rests: bool = False


class GoalExecutor:
    """Carries out one goal at a time; a new one cancels the one before.

    monitor: None: contacts are not checked. In each step: `check`, then `start` where there is a
    new goal, then the commands of the parts, then what `reports` has to publish.
    """

    def __init__(
        self,
        parts: Parts,
        *,
        monitor: CollisionMonitor | None = None,
        avoidance: AvoidanceSettings | None = None,
    ) -> None:
        self.reports = Reports()
        self._parts = parts
        settings = avoidance or AvoidanceSettings()
        self._avoidance = Avoidance(parts, self.reports, monitor, settings)
        self._lost_planner = ""
        self._active: _Active | None = None
        self._measured: Measured | None = None

    def hold(self, now: Measured) -> None:
        """Stand still."""
        self._measured = now
        self._parts.hold(now)

    def start(self, goal: Goal, t: float) -> None:
        """Start a goal at a time [s]; its status reports what is wrong with it."""
        if self._active is not None:
            text = f"goal {goal.id} came before it was done"
            self.reports.status(self._active.goal.id, "cancelled", text=text)
        part = PART_OF[goal.type]
        if self._active is not None and self._active.part != part:
            self._rest(t)
        self._avoidance.start(goal, part)
        try:
            text = self._begin(goal, part, t)
        except RunError as exc:
            cause = exc.cause if isinstance(exc, Refused) else "invalid"
            self.reports.status(goal.id, "failed", cause, str(exc))
            self._rest(t)
            self._active = None
            return
        caution = self._parts.arm.caution if part == "arm" else ""
        self.reports.status(goal.id, "accepted", caution, text)
        self._active = _Active(goal=goal, part=part)

    def _begin(self, goal: Goal, part: Part, t: float) -> str:
        if self._measured is None:
            raise RunError("nothing has been measured yet")
        if self._lost_planner and part != "all":
            raise Refused("no_plan", self._lost_planner)
        return self._parts.start(part, goal, self._measured, t, self._avoidance.held)

    def lose_planner(self, text: str, t: float) -> None:
        """Stop, and fail all goals but `stop`, now and from now on: there are no plans any more."""
        if self._lost_planner:
            return
        self._lost_planner = text
        active = self._active
        if active is not None and active.part != "all":
            self._rest(t)
            self._end(active, Outcome(state="failed", cause="no_plan", text=text))

    def check(self, now: Measured, t: float, dt: float) -> None:
        """Compare with what was measured at a time [s], dt after the step before [s]."""
        self._measured = now
        scale = self._avoidance.scale(now, dt, has_goal=self._active is not None)
        if scale is not None or self._parts.base is not None:
            self._parts.advance(dt, 1.0 if scale is None else scale, self._avoidance.gap)
        ends = self._parts.check(now, t)
        self._parts.secure(now, dt)
        collision, lost = self._avoidance.new_collision(), self._parts.lost(t)
        active = self._active
        if active is None:
            self.reports.warn(str(collision) if collision is not None else "", lost)
            return
        if not active.is_reported:
            active.is_reported = True
            self.reports.status(active.goal.id, "running")
        outcome = self._outcome(active, ends, collision, lost, t)
        if outcome is not None:
            self._end(active, outcome)

    def _outcome(
        self,
        active: _Active,
        ends: dict[Part, Outcome | None],
        collision: Collision | None,
        lost: str,
        t: float,
    ) -> Outcome | None:
        """Return the end of the goal under way, once it has ended."""
        goal, part, avoidance = active.goal, active.part, self._avoidance
        if part == "all":
            self.reports.warn(lost)
            return self._stopped(active, ends["arm"])
        if avoidance.backs_off:
            self.reports.warn(lost)
            return avoidance.check_back_off(goal, part, ends[part], collision, t)
        if collision is not None:
            return avoidance.collide(goal, part, collision, t)
        if lost:
            self._rest(t)
            return Outcome(state="failed", cause="slipped", text=lost)
        if hindrance := avoidance.hindrance(part):
            return avoidance.evade(goal, part, hindrance, t)
        return avoidance.approach(goal, part) or ends[part]

    def _stopped(self, active: _Active, end: Outcome | None) -> Outcome | None:
        if end is not None and end.state == "failed":
            return end
        active.arm_rests = active.arm_rests or end is not None
        if not (active.arm_rests and self._parts.base_rests()):
            return None
        return Outcome(state="succeeded", text="all is at rest")

    def _end(self, active: _Active, outcome: Outcome) -> None:
        cause, text = outcome.cause, outcome.text
        if outcome.state == "succeeded" and active.part == "arm":
            late = self._late(active.goal)
            cause, text = ("slower", f"{late}; {text}") if late else (cause, text)
        self.reports.status(active.goal.id, outcome.state, cause, text)
        self._active = None

    def _late(self, goal: Goal) -> str:
        """Return how much longer than requested a motion took, and why; empty: it did not."""
        took = self._parts.arm.took
        if took is None or goal.duration == 0.0 or took <= goal.duration * _LATE + 0.02:
            return ""
        why = self._avoidance.slowest or "the joints cannot be faster within their limits"
        return f"took {took:.2f} s instead of {goal.duration:.2f} s: {why}"

    def _rest(self, t: float) -> None:
        """Bring to rest what the goal under way has set in motion."""
        if self._active is not None:
            self._parts.rest(self._active.part, t)
