"""Motions of the arm while the gripper, or the base, moves."""

from stepbus_schemas import Goal, RunError
from stepbus_store.motion.active_goal import Active, UnderWay
from stepbus_store.motion.beside_goals import Companion
from stepbus_store.motion.outcome import Measured, Outcome, failure_of
from stepbus_store.motion.parts import Part


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
