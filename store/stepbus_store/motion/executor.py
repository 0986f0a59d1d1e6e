"""Carries out one goal at a time, and reports how it ends."""

from dataclasses import dataclass

from stepbus_schemas import Goal, RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.avoidance import Avoidance
from stepbus_store.motion.back_to_rest import BackToRest
from stepbus_store.motion.concurrent_motion import ConcurrentMotion
from stepbus_store.motion.monitor import CollisionMonitor
from stepbus_store.motion.outcome import Measured, Outcome, Refused, Reports, failure_of
from stepbus_store.motion.parts import PART_OF, Ends, Part, Parts
from stepbus_store.motion.sensed import Collision

_LATE = 1.02
"""Share of the requested duration from which a motion counts as slower."""


@dataclass(kw_only=True)
class ActiveGoal:
    """A goal that is carried out; arm_rests: of a `stop` goal."""

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

    _measured: Measured

    def __init__(self, parts: Parts, monitor: CollisionMonitor | None = None) -> None:
        self.reports = Reports()
        self._parts = parts
        self._avoidance = Avoidance(parts, self.reports, monitor)
        self._active: ActiveGoal | None = None
        # The goal of the base, while the active one is carried out beside it.
        self._driving: ActiveGoal | None = None
        self._concurrent: ConcurrentMotion | None = None
        # A goal that ends with that of the base, which backs off.
        self._stopped_beside: ActiveGoal | None = None
        self._returning: BackToRest | None = None
        self._interrupted = self._lost_planner = ""
        self._goal_id = -1

    def hold(self, now: Measured) -> None:
        """Stand still."""
        self._measured = now
        self._parts.hold(now)

    def interrupt(self, now: Measured, text: str, dt: float) -> None:
        """Instead of `check`, fail all goals, and stay where an emergency stop brings the robot."""
        self._measured, self._interrupted = now, text
        # What is held, and what is touched, is known afterwards.
        self._avoidance.scale(now, dt, has_goal=False)
        end = Outcome(state="failed", cause=Cause.EMERGENCY_STOP, text=text)
        while self._active is not None:
            self._end(self._active, end)
        self._parts.interrupt(now)

    def lose_planner(self, text: str, t: float) -> None:
        """Stop, and fail all goals but `stop`, now and from now on: there are no plans any more."""
        if self._lost_planner:
            return
        self._lost_planner = text
        failure = Outcome(state="failed", cause=Cause.NO_PLAN, text=text)
        for _ in range(2):
            active = self._active
            if active is not None and active.part != "all":
                self._fail(active, failure, t)

    # A goal begins

    def start(self, goal: Goal | None, t: float) -> None:
        """Start a goal with a new id at a time [s]; its status reports what is wrong with it."""
        if goal is None or goal.id == self._goal_id:
            return
        self._goal_id = goal.id
        if self._interrupted:
            self.reports.status(goal.id, "failed", Cause.EMERGENCY_STOP, self._interrupted)
            return
        part, driving = PART_OF[goal.type], self._driving or self._active
        if goal.base is not None and driving is not None and self._takes_beside(driving, part):
            self._start_beside(goal, part, driving, t)
            return
        before = (self._active, self._driving, self._stopped_beside)
        cancelled = [old for old in before if old is not None]
        for old in cancelled:
            self._cancel(old, goal)
            if old.part != part:
                self._parts.rest(old.part, t)
        self._driving = self._concurrent = self._returning = self._stopped_beside = None
        self._avoidance.start(goal, part)
        active = ActiveGoal(goal=goal, part=part)
        try:
            text = self._move(goal, part, t)
        except RunError as exc:
            self._report_end(active, failure_of(exc))
            for old in cancelled:
                self._parts.rest(old.part, t)
            self._active = None
            return
        caution = self._parts.arm.caution if part == "arm" else ""
        self.reports.status(goal.id, "accepted", caution, text)
        self._active = active

    def _takes_beside(self, driving: ActiveGoal, part: Part) -> bool:
        """Return whether a goal of a part can be carried out beside another one, the base's."""
        drives = driving.part == "base" and not self._avoidance.backs_off
        return drives and part in {"arm", "gripper"} and self._parts.navigator is not None

    def _start_beside(self, goal: Goal, part: Part, driving: ActiveGoal, t: float) -> None:
        """Start a goal beside that of the base, in place of the one that was beside it."""
        if self._active is not None and self._active is not driving:
            self._cancel(self._active, goal)
            self._parts.rest(self._active.part, t)
        self._active = active = ActiveGoal(goal=goal, part=part)
        self._driving = driving
        if self._concurrent is not None:
            self._concurrent.leave(is_done=False)
        self._concurrent = None
        self._avoidance.join(goal, part, driving.goal)
        try:
            text = self._move(goal, part, t)
        except RunError as exc:
            self._end(active, failure_of(exc))
            return
        self.reports.status(goal.id, "accepted", text=text)

    def _move(self, goal: Goal, part: Part, t: float) -> str:
        """Start the motion of a goal and return a sentence for its status; raises RunError."""
        parts, held = self._parts, self._avoidance.held
        if part != "all" and self._lost_planner:
            raise Refused(Cause.NO_PLAN, self._lost_planner)
        if part == "arm" and self._driving is not None and parts.base and parts.navigator:
            self._concurrent = ConcurrentMotion(
                goal=goal, held=held, arm=parts.arm, base=parts.base, navigator=parts.navigator
            )
            return "beside the base"
        if goal.type == "back_to_rest":
            self._returning = BackToRest(goal=goal, held=held, arm=parts.arm)
            return self._returning.start(self._measured, t)
        return parts.start(part, goal, self._measured, t, held)

    # A step

    def check(self, now: Measured, t: float, dt: float) -> None:
        """Compare with what was measured at a time [s], dt after the step before [s]."""
        self._measured, self._interrupted = now, ""
        scale = self._avoidance.scale(now, dt, has_goal=self._active is not None)
        if scale is not None or self._parts.base is not None:
            self._parts.advance(dt, 1.0 if scale is None else scale, self._avoidance.room)
            self._avoidance.hurry(t)
        ends = self._parts.check(now, t)
        self._parts.secure(now, dt)
        collision, lost = self._avoidance.new_collision(), self._parts.lost(t)
        # An arm that runs into something does not follow either, nor does it always get away from
        # that: then the collision is the cause.
        is_hit = collision is not None or self._avoidance.backs_off
        jam = "" if is_hit else self._parts.arm.jam(now.q, now.effort, t)
        self._check_base(ends.get("base"), collision, lost, now, t)
        active = self._active
        if active is None:
            self.reports.warn(str(collision) if collision is not None else "", lost, jam)
            return
        if not active.is_reported:
            active.is_reported = True
            self.reports.status(active.goal.id, "running")
        if self._ends_jammed(active, jam, t):
            return
        if self._concurrent is not None:
            outcome = self._accompanied(self._concurrent, ends["arm"], now, t)
        else:
            outcome = self._outcome(active, ends, collision, lost, t)
        if outcome is not None and self._returning is not None:
            self.reports.warn(outcome.text if outcome.state == "failed" else "")
            outcome = self._returning.follow(outcome, now, t)
            if outcome is None:
                self._avoidance.join(active.goal, active.part)
        if outcome is not None:
            self._end(active, outcome)

    def _check_base(
        self, end: Outcome | None, collision: Collision | None, lost: str, now: Measured, t: float
    ) -> None:
        """Follow the goal of the base while another part moves; end: of the base's motion."""
        active, driving, concurrent = self._active, self._driving, self._concurrent
        if active is None or driving is None:
            return
        if collision is not None or lost:
            # Both stop; then the base backs off. The goal beside its own ends with it.
            self._parts.rest(active.part, t, touches=collision is not None)
            self._active, self._driving, self._concurrent = driving, None, None
            self._stopped_beside = active
            return
        try:
            if concurrent is not None:
                concurrent.check(now, t)
            end = self._avoidance.approach(driving.goal, "base", t) or end
            if end is not None:
                self._driving = None
                self._report_end(driving, end)
                # What moves beside it continues, unless that failed.
                if end.state != "succeeded":
                    self._fail(active, end, t)
                    return
                self._avoidance.join(active.goal, active.part)
                if concurrent is not None:
                    concurrent.arrived(now, t)
            elif concurrent is not None and self._parts.base_stops():
                concurrent.postpone(now, t)
        except RunError as exc:
            self._fail(active, failure_of(exc), t)

    def _accompanied(
        self, concurrent: ConcurrentMotion, end: Outcome | None, now: Measured, t: float
    ) -> Outcome | None:
        """Return the end of an arm's goal beside the base's; end: of the arm's motion."""
        drives = self._driving is not None
        try:
            end = concurrent.follow(end, now, t)
            moves = concurrent.phase == "moves"
            if end is None and drives and moves and self._avoidance.hindrance("arm"):
                self._avoidance.remember()
                concurrent.postpone(now, t, is_urgent=self._avoidance.is_urgent)
        except RunError as exc:
            return failure_of(exc)
        if end is None and concurrent.phase == "moves" and not drives:
            # From now on it is a goal like any other.
            self._concurrent = None
        if end is not None and end.state == "failed" and not concurrent.navigator.waits:
            self._stop_driving(end, t)
        return end

    def _stop_driving(self, end: Outcome, t: float) -> None:
        """Stop the base, since the arm beside it is not where it should be; end: of the arm."""
        driving, self._driving = self._driving, None
        if driving is not None:
            self._parts.rest(driving.part, t)
            self._report_end(driving, end)

    def _ends_jammed(self, active: ActiveGoal, jam: str, t: float) -> bool:
        """End the active goal where a joint of the arm is jammed; a stop goes on."""
        if not jam or active.part == "all":
            self.reports.warn(jam)
            return False
        end = Outcome(state="failed", cause=Cause.ARM_JAMMED, text=jam)
        if active.part != "arm":
            self._parts.rest(active.part, t)
        self._stop_driving(end, t)
        self._end(active, end)
        return True

    def _outcome(
        self, active: ActiveGoal, ends: Ends, collision: Collision | None, lost: str, t: float
    ) -> Outcome | None:
        """Return the end of the active goal, once it has ended."""
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
            self._parts.rest(part, t)
            return Outcome(state="failed", cause=Cause.SLIPPED, text=lost)
        if hindrance := avoidance.hindrance(part):
            return avoidance.evade(goal, part, hindrance, t)
        return avoidance.approach(goal, part, t) or ends[part]

    def _stopped(self, active: ActiveGoal, end: Outcome | None) -> Outcome | None:
        if end is not None and end.state == "failed":
            return end
        active.arm_rests = active.arm_rests or end is not None
        rests = active.arm_rests and self._parts.base_rests()
        return Outcome(state="succeeded", text="all is at rest") if rests else None

    # A goal ends

    def _cancel(self, old: ActiveGoal, by: Goal) -> None:
        text = f"goal {by.id} came before it was done"
        self.reports.status(old.goal.id, "cancelled", text=text)

    def _report_end(self, ended: ActiveGoal, outcome: Outcome) -> None:
        self.reports.status(ended.goal.id, outcome.state, outcome.cause, outcome.text)

    def _fail(self, active: ActiveGoal, failure: Outcome, t: float) -> None:
        self._parts.rest(active.part, t)
        self._end(active, failure)

    def _end(self, active: ActiveGoal, outcome: Outcome) -> None:
        """End the active goal; that of the base continues."""
        if outcome.state == "succeeded" and active.part == "arm":
            outcome = self._timed(active.goal, outcome)
        self._report_end(active, outcome)
        if self._concurrent is not None:
            self._concurrent.leave(is_done=outcome.state == "succeeded")
        self._active, self._driving, self._concurrent = self._driving, None, None
        self._returning = None
        beside, self._stopped_beside = self._stopped_beside, None
        if beside is not None:
            self._report_end(beside, outcome)
        if self._active is not None:
            self._avoidance.join(self._active.goal, self._active.part)

    def _timed(self, goal: Goal, outcome: Outcome) -> Outcome:
        """Return a success that names how much longer than requested it took."""
        took = self._parts.arm.took
        if took is None or goal.duration == 0.0 or took <= goal.duration * _LATE + 0.02:
            return outcome
        text = f"took {took:.2f} s instead of {goal.duration:.2f} s; {outcome.text}"
        return Outcome(state="succeeded", cause=Cause.SLOWER, text=text)
