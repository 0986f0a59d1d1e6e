"""Reactions to collisions, and to obstacles that come into the path."""

from dataclasses import replace

from stepbus_kinematics import Vector
from stepbus_schemas import Goal, RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.monitor import CollisionMonitor
from stepbus_store.motion.navigator import REPLANS
from stepbus_store.motion.outcome import Measured, Outcome, Reports
from stepbus_store.motion.parts import MOVES, Part, Parts
from stepbus_store.motion.retreat import ArmRetreat, BaseBackOff
from stepbus_store.motion.sensed import Approach, Collision, SensedThings, Watch

_REACH = 0.5
"""Of the robot from the axis about which its base turns [m]."""

_APART = 5e-3
"""Farther than this from what it backs off from, the robot must not touch that again [m]."""

_COMES = 2e-3
"""What needs less than this to stop does not come closer, but is measured with noise [m]."""

_BACK_OFF = 0.05
"""How far the robot goes back from what it has touched [m]."""

_STOP_WITHIN = 0.004
"""On a planner's path, an arm stops before something is closer; less than the planner's margin
[m]."""


_ROOM = 0.02
"""An arm that stands farther than this from what it has stopped for need not leave it [m]."""


class Avoidance:
    """Watches a goal for collisions: slows the robot down, stops it, backs it off, replans.

    monitor: None: nothing senses contacts. Call `scale` in each step first.
    """

    def __init__(self, parts: Parts, reports: Reports, monitor: CollisionMonitor | None) -> None:
        self._parts = parts
        self._reports = reports
        self._monitor = monitor
        self._watch = Watch()
        self._touched: tuple[str, str] | None = None
        self._is_slow = False
        self._base_back_off: BaseBackOff | None = None
        self._near: Approach | None = None
        self._replans = 0
        self._sensed = SensedThings(_STOP_WITHIN)
        self._hindrance: Approach | None = None
        self._q: Vector | None = None
        self._retreat: ArmRetreat | None = None
        self._is_beside = False

    @property
    def held(self) -> str:
        """Return the link of the world in the gripper; empty: none."""
        return self._monitor.held if self._monitor is not None else ""

    def start(self, goal: Goal, part: Part) -> None:
        """Watch a new goal."""
        self._touched, self._is_slow = None, False
        self._base_back_off, self._near = None, None
        self.join(goal, part)

    def join(self, goal: Goal, part: Part, driving: Goal | None = None) -> None:
        """Watch a goal in place of another, or beside the base's; what happened to it counts on."""
        self._retreat, self._replans = None, 0
        self._is_beside = driving is not None
        self._monitor_goal(goal, part, driving)

    def _monitor_goal(self, goal: Goal, part: Part, driving: Goal | None = None) -> None:
        if self._monitor is not None:
            touches = goal.touches if driving is None else [*goal.touches, *driving.touches]
            moves = MOVES[part] if driving is None else "all"
            self._monitor.start(touches, grips=goal.type == "grip", moves=moves)

    def scale(self, now: Measured, dt: float, *, has_goal: bool) -> float | None:
        """Return the robot's share of its full speed, dt [s] after the last; None: unmonitored."""
        if self._monitor is None or now.contacts is None:
            self._watch = Watch()
            return None
        watch = self._watch = self._monitor.update(
            now.contacts,
            holding=now.gripper.holding,
            dt=dt,
            speed_of=self._parts.arm.link_speeds(),
            base_speed=abs(now.base.vx) + _REACH * abs(now.base.wz),
        )
        if watch.near is not None and not self._is_slow and has_goal:
            ours, other = watch.near
            self._reports.warn(f"{ours} is {watch.gap * 1e3:.0f} mm from {other}: slower")
        self._is_slow = watch.near is not None
        self._q = now.q
        self._sensed.update(watch, is_moving=self._parts.arm.is_moving)
        self._monitor.wary = self._sensed.known
        return watch.scale

    @property
    def room(self) -> float:
        """Return how far the base may go until it must not be any closer to something [m]."""
        room = self._watch.room
        if not self._is_beside or self._monitor is None or room >= self._monitor.range:
            return room
        # Each of both may use up one half, the arm that of the gap from which on it slows down.
        return max(room / 2, room - self._monitor.slow_within / 2)

    def new_collision(self) -> Collision | None:
        """Return a collision when it starts; each pair of links once for each goal."""
        collision, before = self._watch.collision, self._touched
        self._touched = None if collision is None else collision.pair
        return None if self._touched == before else collision

    def collide(self, goal: Goal, part: Part, collision: Collision, t: float) -> Outcome | None:
        """Stop, and back off along the path so far; return the end of a goal that cannot."""
        base, monitor = self._parts.base, self._monitor
        if part == "base" and base is not None and monitor is not None:
            # To drive away from itself does not help.
            distance = 0.0 if monitor.is_ours(collision.other) else _BACK_OFF
            self._base_back_off = BaseBackOff(
                base=base, monitor=monitor, goal=goal, collision=collision, distance=distance
            )
            return None
        if part == "gripper":
            self._parts.rest(part, t)
            text = f"{collision}; stopped"
            return Outcome(state="failed", cause=Cause.COLLISION, text=text)
        may_replan = part == "arm" and self._parts.arm.follows_plan and self._replans < REPLANS
        length = self._parts.back_off_arm(t, _BACK_OFF)
        self._retreat = ArmRetreat(
            left=collision,
            why=str(collision),
            cause=Cause.COLLISION,
            may_replan=may_replan and length > 0.0,
            length=length,
        )
        self._monitor_goal(goal, part)
        return None

    @property
    def backs_off(self) -> bool:
        """Return whether the robot backs off from what it has touched, or has stopped before."""
        return self._base_back_off is not None or self._retreat is not None

    def check_back_off(
        self, goal: Goal, part: Part, end: Outcome | None, collision: Collision | None, t: float
    ) -> Outcome | None:
        """Return the end of the goal once the robot has backed off, unless it gets another path.

        end: of the part's motion. collision: that has just started.
        """
        if self._base_back_off is not None:
            return self._base_back_off.check(collision)
        retreat = self._retreat
        if retreat is None:
            return None
        if retreat.length is None and collision is not None:
            self._retreat = None
            return self.collide(goal, part, collision, t)
        if retreat.length is not None and (obstacle := self._behind(retreat, collision)):
            self._parts.rest(part, t, touches=True)
            failure = retreat.failure(obstacle)
            self._reports.warn(failure.text)
            return failure
        return None if end is None else self._retreated(retreat, goal, part, end, t)

    def _retreated(
        self, retreat: ArmRetreat, goal: Goal, part: Part, end: Outcome, t: float
    ) -> Outcome | None:
        """Go back, ask for another path, or return the end of the goal; end: of the motion."""
        left = retreat.left.other
        is_close = any(near.gap < _ROOM for near, _ in self._watch.unexpected if near.other == left)
        if retreat.length is None and end.state == "succeeded" and is_close:
            retreat.length = self._parts.back_off_arm(t, _BACK_OFF)
            return None
        if end.state != "succeeded" or not retreat.may_replan:
            return retreat.failure()
        self._retreat = None
        return self.replan(goal, part, retreat.text, t)

    def _behind(self, retreat: ArmRetreat, collision: Collision | None) -> str:
        """Return the obstacle in the way of an arm that backs off; empty: none.

        What it backs off from counts again once the arm was apart from it. collision: that has
        just started.
        """
        left = retreat.left.pair
        if self._monitor is not None and not retreat.is_apart:
            force, gap = self._monitor.touch(left)
            retreat.is_apart = force == 0.0 and (gap is None or gap > _APART)
        if collision is not None and (retreat.is_apart or collision.pair != left):
            return str(collision)
        if not self._watch.unexpected:
            return ""
        near, room = self._watch.unexpected[0]
        comes = near.gap - room > _COMES and room < _STOP_WITHIN
        return str(near) if comes and (near.pair != left or retreat.is_apart) else ""

    def approach(self, goal: Goal, part: Part, t: float) -> Outcome | None:
        """Stop a base for what is in its way, or too close; return the end of its goal."""
        base, monitor, navigator = self._parts.base, self._monitor, self._parts.navigator
        if part != "base" or base is None or monitor is None:
            return None
        if navigator is not None and navigator.hindrance and self._near is None:
            if gives_way := navigator.give_way(t):
                self._reports.go_on(goal.id, gives_way)
            return None
        if self._near is None:
            self._near = monitor.approach() if base.is_moving else None
            if self._near is not None:
                base.halt()
            return None
        if base.is_halting:
            return None
        near, self._near = self._near, None
        _, gap = monitor.touch(near.pair)
        near = near if gap is None else replace(near, gap=gap)
        text = f"{near}; stopped before it touches"
        # A route is for a base whose arm is drawn in.
        may_replan = navigator is not None and monitor.is_base(near.ours)
        if navigator is not None and may_replan and (asked := navigator.replan(text)):
            self._reports.go_on(goal.id, asked)
            return None
        return Outcome(state="failed", cause=Cause.BLOCKED, text=text)

    def hindrance(self, part: Part) -> str:
        """Return a sentence about what hinders an arm on a path; empty: nothing."""
        if part != "arm":
            return ""
        # How close its own links come on a path, the planner has checked.
        arm, self._hindrance = self._parts.arm, None
        if not arm.blocked:
            self._hindrance = self._sensed.hindrance(self._watch, on_plan=arm.follows_plan)
        return str(self._hindrance or arm.blocked)

    def remember(self) -> bool:
        """Remember where what is sensed hinders the arm; return whether it has done so before."""
        near = self._hindrance
        if near is None or self._q is None:
            return False
        return self._sensed.remember(near, self._parts.arm.links.position(near.ours, self._q))

    @property
    def is_urgent(self) -> bool:
        """Return whether the arm hits something unless it stops harder than the gripper holds."""
        return any(left < 0.0 for _, left in self._watch.unexpected)

    def hurry(self, t: float) -> None:
        """Stop harder than the gripper holds, where the stop under way turns out too weak."""
        if self.is_urgent:
            self._parts.arm.stop_harder(t)

    def evade(self, goal: Goal, part: Part, why: str, t: float) -> Outcome | None:
        """Stop for a hindrance; ask for another path, or return the end of a goal without one.

        A straight line has no other path. What only the skin senses, the planner may not know: the
        arm leaves it first, and gives up where another path leads to the same place.
        """
        again = self.remember()
        if not self._parts.arm.follows_plan:
            return self._give_up(part, f"{why}; stopped", t, Cause.BLOCKED)
        if again:
            return self._give_up(part, f"{why}; stopped; another path leads there again", t)
        if self._hindrance is None:
            return self.replan(goal, part, why, t)
        left = self._hindrance
        self._retreat = ArmRetreat(left=left, why=why, cause=Cause.NO_PATH, may_replan=True)
        self._parts.arm.stop(t, touches=self.is_urgent, keeps_route=True)
        self._reports.warn(f"{why}; stops")
        return None

    def replan(self, goal: Goal, part: Part, why: str, t: float) -> Outcome | None:
        """Stop and ask for another path; return the end of a goal that cannot have one."""
        stopped = why if "; stopped" in why else f"{why}; stopped"
        if self._replans == REPLANS:
            return self._give_up(part, f"{stopped}, after {REPLANS} other paths", t)
        self._replans += 1
        try:
            self._parts.arm.replan(t, touches=self.is_urgent)
        except RunError as exc:
            return self._give_up(part, f"{stopped}; {exc}", t)
        self._monitor_goal(goal, part)
        text = f"{stopped}, asked for another path ({self._replans} of {REPLANS})"
        self._reports.go_on(goal.id, text)
        return None

    def _give_up(self, part: Part, text: str, t: float, cause: Cause = Cause.NO_PATH) -> Outcome:
        self._parts.rest(part, t, touches=self.is_urgent)
        return Outcome(state="failed", cause=cause, text=text)
