"""Carries out one goal at a time, and reports what becomes of it."""

from dataclasses import dataclass

from stepbus_motion.collisions.avoidance import Avoidance, AvoidanceSettings
from stepbus_motion.collisions.monitor import Collision, CollisionMonitor
from stepbus_schemas import Goal, RunError

from .back_to_rest import BackToRest
from .beside import Companion
from .measured import Measured
from .outcome import Outcome, Refused
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
    """Carries out one goal at a time; a new one cancels the one before, unless it has `base`.

    Beside a goal of the base, one of the arm or the gripper is carried out, and then another one.

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
        self._driving: _Active | None = None
        self._companion: Companion | None = None
        self._return: BackToRest | None = None
        self._stopped_beside: _Active | None = None
        self._measured: Measured | None = None

    def hold(self, now: Measured) -> None:
        """Stand still."""
        self._measured = now
        self._parts.hold(now)

    def start(self, goal: Goal, t: float) -> None:
        """Start a goal at a time [s]; its status reports what is wrong with it."""
        part = PART_OF[goal.type]
        if goal.base is not None and self._joins(part):
            self._join(goal, part, t)
            return
        beside, self._stopped_beside = self._stopped_beside, None
        cancelled = [old for old in (self._active, self._driving, beside) if old is not None]
        for old in cancelled:
            text = f"goal {goal.id} came before it was done"
            self.reports.status(old.goal.id, "cancelled", text=text)
            if old.part != part:
                self._parts.rest(old.part, t)
        self._driving, self._companion, self._return = None, None, None
        self._avoidance.start(goal, part)
        try:
            text = self._begin(goal, part, t)
        except RunError as exc:
            cause = exc.cause if isinstance(exc, Refused) else "invalid"
            self.reports.status(goal.id, "failed", cause, str(exc))
            for old in cancelled:
                self._parts.rest(old.part, t)
            self._active = None
            return
        caution = self._parts.arm.caution if part == "arm" else ""
        self.reports.status(goal.id, "accepted", caution, text)
        self._active = _Active(goal=goal, part=part)

    def _joins(self, part: Part) -> bool:
        """Return whether a goal of a part can be carried out beside the base's."""
        drives = self._driving or self._active
        is_driving = drives is not None and drives.part == "base" and not self._avoidance.backs_off
        return is_driving and part in {"arm", "gripper"} and self._parts.navigator is not None

    def _join(self, goal: Goal, part: Part, t: float) -> None:
        """Carry out a goal beside that of the base."""
        base, navigator, now = self._parts.base, self._parts.navigator, self._measured
        if base is None or navigator is None or now is None:
            raise RunError("there is no base to move beside")
        if self._driving is None:
            self._driving = self._active
        elif self._active is not None:
            text = f"goal {goal.id} came before it was done"
            self.reports.status(self._active.goal.id, "cancelled", text=text)
            self._rest(t)
        self._active = active = _Active(goal=goal, part=part)
        if self._companion is not None:
            self._companion.leave(is_done=False)
        self._companion = None
        if self._driving is not None:
            self._avoidance.join(goal, part, self._driving.goal)
        text = "beside the base"
        try:
            if self._lost_planner:
                raise Refused("no_plan", self._lost_planner)
            if part == "arm":
                self._companion = Companion(
                    goal=goal,
                    held=self._avoidance.held,
                    arm=self._parts.arm,
                    base=base,
                    navigator=navigator,
                )
            else:
                text = self._begin(goal, part, t)
        except RunError as exc:
            cause = exc.cause if isinstance(exc, Refused) else "invalid"
            self._end(active, Outcome(state="failed", cause=cause, text=str(exc)))
            return
        self.reports.status(goal.id, "accepted", text=text)

    def _begin(self, goal: Goal, part: Part, t: float) -> str:
        if self._measured is None:
            raise RunError("nothing has been measured yet")
        if self._lost_planner and part != "all":
            raise Refused("no_plan", self._lost_planner)
        if goal.type == "back_to_rest":
            arm = self._parts.arm
            self._return = BackToRest(goal=goal, held=self._avoidance.held, arm=arm, tip=arm.tip)
            return self._return.start(self._measured, t)
        return self._parts.start(part, goal, self._measured, t, self._avoidance.held)

    def lose_planner(self, text: str, t: float) -> None:
        """Stop, and fail all goals but `stop`, now and from now on: there are no plans any more."""
        if self._lost_planner:
            return
        self._lost_planner = text
        failure = Outcome(state="failed", cause="no_plan", text=text)
        for _ in range(2):
            active = self._active
            if active is not None and active.part != "all":
                self._rest(t)
                self._end(active, failure)

    def check(self, now: Measured, t: float, dt: float) -> None:
        """Compare with what was measured at a time [s], dt after the step before [s]."""
        self._measured = now
        scale = self._avoidance.scale(now, dt, has_goal=self._active is not None)
        if scale is not None or self._parts.base is not None:
            self._parts.advance(dt, 1.0 if scale is None else scale, self._avoidance.room)
        ends = self._parts.check(now, t)
        self._parts.secure(now, dt)
        collision, lost = self._avoidance.new_collision(), self._parts.lost(t)
        if self._driving is not None:
            self._check_driving(self._driving, ends, collision, lost, t)
        active = self._active
        if active is None:
            self.reports.warn(str(collision) if collision is not None else "", lost)
            return
        if not active.is_reported:
            active.is_reported = True
            self.reports.status(active.goal.id, "running")
        if self._companion is not None:
            outcome = self._accompanied(self._companion, active, ends, t)
        else:
            outcome = self._outcome(active, ends, collision, lost, t)
        if outcome is not None and self._return is not None:
            self.reports.warn(outcome.text if outcome.state == "failed" else "")
            outcome = self._return.follow(outcome, now, t)
            if outcome is None:
                self._avoidance.join(active.goal, active.part)
        if outcome is not None:
            self._end(active, outcome)

    def _check_driving(
        self,
        driving: _Active,
        ends: dict[Part, Outcome | None],
        collision: Collision | None,
        lost: str,
        t: float,
    ) -> None:
        """Follow the goal of the base while another part moves beside it."""
        now, active = self._measured, self._active
        if now is None or active is None:
            return
        if collision is not None or lost:
            # Both stop; then the base backs off. The goal beside its own ends with it.
            self._rest(t, touches=collision is not None)
            self._active, self._driving, self._companion = driving, None, None
            self._stopped_beside = active
            return
        companion = self._companion
        try:
            if companion is not None:
                companion.check(now, t)
            end = self._avoidance.approach(driving.goal, "base") or ends["base"]
            if end is None:
                if self._parts.base is not None and self._parts.base.is_halting and companion:
                    companion.postpone(now, t)
                return
            self._arrive(driving, end, now, t)
        except RunError as exc:
            cause = exc.cause if isinstance(exc, Refused) else "invalid"
            self._rest(t)
            self._end(active, Outcome(state="failed", cause=cause, text=str(exc)))

    def _arrive(self, driving: _Active, end: Outcome, now: Measured, t: float) -> None:
        """Report the end of the base's goal; what moves beside it goes on, unless that failed."""
        active, self._driving = self._active, None
        self.reports.status(driving.goal.id, end.state, end.cause, end.text)
        if active is None:
            return
        if end.state != "succeeded":
            self._rest(t)
            self._end(active, end)
            return
        self._avoidance.join(active.goal, active.part)
        if self._companion is not None:
            self._companion.arrived(now, t)

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

    def _accompanied(
        self,
        companion: Companion,
        active: _Active,
        ends: dict[Part, Outcome | None],
        t: float,
    ) -> Outcome | None:
        """Return the end of an arm's goal beside the base's, once it has ended."""
        now = self._measured
        if now is None:
            return None
        try:
            end = companion.follow(ends["arm"], now, t)
            drives, moves = self._driving is not None, companion.phase == "moves"
            if end is None and drives and moves and self._avoidance.hindrance("arm"):
                companion.postpone(now, t)
        except RunError as exc:
            cause = exc.cause if isinstance(exc, Refused) else "invalid"
            return Outcome(state="failed", cause=cause, text=str(exc))
        if end is None and companion.phase == "moves" and self._driving is None:
            # From now on it is a goal like any other.
            self._companion = None
        if end is not None and end.state == "failed" and not companion.navigator.waits:
            self._stop_driving(end, t)
        return end

    def _stop_driving(self, end: Outcome, t: float) -> None:
        """Stop the base, since the arm beside it is not where it should be; end: of the arm."""
        driving, self._driving = self._driving, None
        if driving is not None:
            self._parts.rest(driving.part, t)
            self.reports.status(driving.goal.id, end.state, end.cause, end.text)

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
        if self._companion is not None:
            self._companion.leave(is_done=outcome.state == "succeeded")
        self._active, self._driving, self._companion = self._driving, None, None
        self._return = None
        beside, self._stopped_beside = self._stopped_beside, None
        if beside is not None:
            self.reports.status(beside.goal.id, outcome.state, cause, text)
        if self._active is not None:
            self._avoidance.join(self._active.goal, self._active.part)

    def _late(self, goal: Goal) -> str:
        """Return how much longer than requested a motion took, and why; empty: it did not."""
        took = self._parts.arm.took
        if took is None or goal.duration == 0.0 or took <= goal.duration * _LATE + 0.02:
            return ""
        why = self._avoidance.slowest or "the joints cannot be faster within their limits"
        return f"took {took:.2f} s instead of {goal.duration:.2f} s: {why}"

    def _rest(self, t: float, *, touches: bool = False) -> None:
        """Bring to rest what the goal under way has set in motion."""
        if self._active is not None:
            self._parts.rest(self._active.part, t, touches=touches)
