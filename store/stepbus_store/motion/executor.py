"""Carries out one goal at a time, and reports what becomes of it."""

from stepbus_schemas import Goal, RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.active_goal import Active, UnderWay
from stepbus_store.motion.avoidance import Avoidance
from stepbus_store.motion.beside_goals import Companion
from stepbus_store.motion.monitor import CollisionMonitor
from stepbus_store.motion.outcome import Measured, Outcome, Reports, failure_of
from stepbus_store.motion.parts import PART_OF, Part, Parts
from stepbus_store.motion.sensed import Collision


class BesideBase:
    """Carries out one goal at a time beside that of the base, and stops both together."""

    def __init__(self, goals: UnderWay) -> None:
        self._goals = goals
        self._parts = goals.parts
        self._avoidance = goals.avoidance

    def takes(self, part: Part) -> bool:
        """Return whether a goal of a part can be carried out beside the base's."""
        drives = self._goals.driving or self._goals.active
        is_driving = drives is not None and drives.part == "base" and not self._avoidance.backs_off
        return is_driving and part in {"arm", "gripper"} and self._parts.navigator is not None

    def start(self, goal: Goal, part: Part, now: Measured | None, t: float) -> None:
        """Start a goal beside that of the base, in place of the one that was beside it."""
        goals = self._goals
        if goals.driving is None:
            goals.driving = goals.active
        elif goals.active is not None:
            goals.cancel(goals.active, goal)
            goals.rest(t)
        goals.active = active = Active(goal=goal, part=part)
        if goals.companion is not None:
            goals.companion.leave(is_done=False)
        goals.companion = None
        if goals.driving is not None:
            self._avoidance.join(goal, part, goals.driving.goal)
        text = "beside the base"
        try:
            goals.check_planner()
            if part == "arm":
                goals.companion = self._companion(goal)
            else:
                text = goals.move(goal, part, now, t)
        except RunError as exc:
            goals.end(active, failure_of(exc))
            return
        goals.reports.status(goal.id, "accepted", text=text)

    def _companion(self, goal: Goal) -> Companion:
        base, navigator = self._parts.base, self._parts.navigator
        if base is None or navigator is None:
            raise RunError("the goal sets `base`, but this robot has no mobile base")
        arm, held = self._parts.arm, self._avoidance.held
        return Companion(goal=goal, held=held, arm=arm, base=base, navigator=navigator)

    def check(
        self, end: Outcome | None, now: Measured, t: float, *, touches: bool, loses: bool
    ) -> None:
        """Follow the goal of the base while another part moves beside it.

        end: of the base's motion. touches: the robot has collided. loses: an item slipped away.
        """
        goals = self._goals
        driving, active, companion = goals.driving, goals.active, goals.companion
        if driving is None or active is None:
            return
        if touches or loses:
            # Both stop; then the base backs off. The goal beside its own ends with it.
            goals.rest(t, touches=touches)
            goals.active, goals.driving, goals.companion = driving, None, None
            goals.stopped_beside = active
            return
        try:
            if companion is not None:
                companion.check(now, t)
            end = self._avoidance.approach(driving.goal, "base", t) or end
            if end is not None:
                self._arrive(driving, active, end, now, t)
            elif self._stops() and companion:
                companion.postpone(now, t)
        except RunError as exc:
            goals.fail(active, exc, t)

    def _stops(self) -> bool:
        """Return whether the base is brought to rest before it has arrived."""
        base, navigator = self._parts.base, self._parts.navigator
        held_up = navigator is not None and navigator.is_held_up and not navigator.drives
        return base is not None and (base.is_halting or (held_up and base.is_moving))

    def _arrive(
        self, driving: Active, active: Active, end: Outcome, now: Measured, t: float
    ) -> None:
        """Report the end of the base's goal; what moves beside it continues, unless that failed."""
        goals = self._goals
        goals.driving = None
        goals.report_end(driving, end)
        if end.state != "succeeded":
            goals.rest(t)
            goals.end(active, end)
            return
        self._avoidance.join(active.goal, active.part)
        if goals.companion is not None:
            goals.companion.arrived(now, t)

    def outcome(
        self, companion: Companion, end: Outcome | None, now: Measured, t: float
    ) -> Outcome | None:
        """Return the end of an arm's goal beside the base's, once it has ended.

        end: of the arm's motion.
        """
        goals = self._goals
        try:
            end = companion.follow(end, now, t)
            drives, moves = goals.driving is not None, companion.phase == "moves"
            if end is None and drives and moves and self._avoidance.hindrance("arm"):
                self._avoidance.remember()
                companion.postpone(now, t, is_urgent=self._avoidance.is_urgent)
        except RunError as exc:
            return failure_of(exc)
        if end is None and companion.phase == "moves" and goals.driving is None:
            # From now on it is a goal like any other.
            goals.companion = None
        if end is not None and end.state == "failed" and not companion.navigator.waits:
            self.stop_driving(end, t)
        return end

    def stop_driving(self, end: Outcome, t: float) -> None:
        """Stop the base, since the arm beside it is not where it should be; end: of the arm."""
        driving, self._goals.driving = self._goals.driving, None
        if driving is not None:
            self._parts.rest(driving.part, t)
            self._goals.report_end(driving, end)


class GoalExecutor:
    """Carries out one goal at a time; a new one cancels the one before, unless it has `base`.

    Beside a goal of the base, one of the arm or the gripper is carried out, and then another one.

    monitor: None: contacts are not checked. In each step: `check`, then `start` where there is a
    new goal, then the commands of the parts, then what `reports` has to publish.
    """

    def __init__(self, parts: Parts, monitor: CollisionMonitor | None = None) -> None:
        self.reports = Reports()
        self._parts = parts
        self._avoidance = Avoidance(parts, self.reports, monitor)
        self._goals = UnderWay(parts, self.reports, self._avoidance)
        self._beside = BesideBase(self._goals)
        self._measured: Measured | None = None
        self._interrupted = ""

    def hold(self, now: Measured) -> None:
        """Stand still."""
        self._measured = now
        self._parts.hold(now)

    def interrupt(self, now: Measured, text: str, dt: float) -> None:
        """Fail all goals, and stay where an emergency stop brings the robot; text: about it.

        Call it instead of `check` in each step in which it is active.
        """
        self._measured, self._interrupted = now, text
        # What is held, and what is touched, is known afterwards.
        self._avoidance.scale(now, dt, has_goal=False)
        goals, end = self._goals, Outcome(state="failed", cause=Cause.EMERGENCY_STOP, text=text)
        while goals.active is not None:
            goals.end(goals.active, end)
        self._parts.interrupt(now)

    def start(self, goal: Goal, t: float) -> None:
        """Start a goal at a time [s]; its status reports what is wrong with it."""
        if self._interrupted:
            self.reports.status(goal.id, "failed", Cause.EMERGENCY_STOP, self._interrupted)
            return
        part, goals, now = PART_OF[goal.type], self._goals, self._measured
        if goal.base is not None and self._beside.takes(part):
            self._beside.start(goal, part, now, t)
            return
        before = (goals.active, goals.driving, goals.stopped_beside)
        cancelled = [old for old in before if old is not None]
        for old in cancelled:
            goals.cancel(old, goal)
            if old.part != part:
                self._parts.rest(old.part, t)
        goals.driving = goals.companion = goals.returning = goals.stopped_beside = None
        self._avoidance.start(goal, part)
        active = Active(goal=goal, part=part)
        try:
            text = goals.move(goal, part, now, t)
        except RunError as exc:
            goals.report_end(active, failure_of(exc))
            for old in cancelled:
                self._parts.rest(old.part, t)
            goals.active = None
            return
        caution = self._parts.arm.caution if part == "arm" else ""
        self.reports.status(goal.id, "accepted", caution, text)
        goals.active = active

    def lose_planner(self, text: str, t: float) -> None:
        """Stop, and fail all goals but `stop`, now and from now on: there are no plans any more."""
        goals = self._goals
        if goals.lost_planner:
            return
        goals.lost_planner = text
        failure = Outcome(state="failed", cause=Cause.NO_PLAN, text=text)
        for _ in range(2):
            active = goals.active
            if active is not None and active.part != "all":
                goals.rest(t)
                goals.end(active, failure)

    def check(self, now: Measured, t: float, dt: float) -> None:
        """Compare with what was measured at a time [s], dt after the step before [s]."""
        self._measured, self._interrupted = now, ""
        goals = self._goals
        scale = self._avoidance.scale(now, dt, has_goal=goals.active is not None)
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
        if goals.driving is not None:
            touches, loses = collision is not None, bool(lost)
            self._beside.check(ends["base"], now, t, touches=touches, loses=loses)
        active = goals.active
        if active is None:
            self.reports.warn(str(collision) if collision is not None else "", lost, jam)
            return
        if not active.is_reported:
            active.is_reported = True
            self.reports.status(active.goal.id, "running")
        if self._ends_jammed(active, jam, t):
            return
        if goals.companion is not None:
            outcome = self._beside.outcome(goals.companion, ends["arm"], now, t)
        else:
            outcome = self._outcome(active, ends, collision, lost, t)
        if outcome is not None and goals.returning is not None:
            self.reports.warn(outcome.text if outcome.state == "failed" else "")
            outcome = goals.returning.follow(outcome, now, t)
            if outcome is None:
                self._avoidance.join(active.goal, active.part)
        if outcome is not None:
            goals.end(active, outcome)

    def _ends_jammed(self, active: Active, jam: str, t: float) -> bool:
        """End the goal under way where a joint of the arm is jammed; a stop goes on."""
        if not jam or active.part == "all":
            self.reports.warn(jam)
            return False
        end = Outcome(state="failed", cause=Cause.ARM_JAMMED, text=jam)
        self._goals.returning = None
        if active.part != "arm":
            self._goals.rest(t)
        self._beside.stop_driving(end, t)
        self._goals.end(active, end)
        return True

    def _outcome(
        self,
        active: Active,
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
            self._goals.rest(t)
            return Outcome(state="failed", cause=Cause.SLIPPED, text=lost)
        if hindrance := avoidance.hindrance(part):
            return avoidance.evade(goal, part, hindrance, t)
        return avoidance.approach(goal, part, t) or ends[part]

    def _stopped(self, active: Active, end: Outcome | None) -> Outcome | None:
        if end is not None and end.state == "failed":
            return end
        active.arm_rests = active.arm_rests or end is not None
        if not (active.arm_rests and self._parts.base_rests()):
            return None
        return Outcome(state="succeeded", text="all is at rest")
