"""Gives each goal to arm, base or gripper, and ends it when something comes in between."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

from stepbus_kinematics import RobotModel, Vector
from stepbus_motion.base.motion import BaseMotion
from stepbus_motion.collisions.monitor import Collision, CollisionMonitor, Moves, Watch
from stepbus_motion.gripper.gripper import Grip
from stepbus_motion.manipulator.manipulator import Manipulator
from stepbus_schemas import BaseState, Contacts, Goal, GoalStatus, GripperState, RunError
from stepbus_schemas.messages import GoalState, GoalType

from .outcome import Outcome, Refused

Part = Literal["arm", "base", "hand", "all"]

_PARTS: dict[GoalType, Part] = {
    "move_joints": "arm",
    "move_to_pose": "arm",
    "move_linear": "arm",
    "spiral": "arm",
    "drive": "base",
    "turn": "base",
    "go_to": "base",
    "grip": "hand",
    "stop": "all",
}
"""Which part of the robot carries out a kind of goal."""

_MOVES: dict[Part, Moves] = {"arm": "arm", "hand": "arm", "base": "base", "all": "all"}
"""What the monitor has to reckon with."""


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """What was measured in a step.

    q, v: of the arm's joints, shape (n,) [rad, rad/s]. contacts: None: nobody senses them.
    """

    q: Vector
    v: Vector
    base: BaseState
    hand: GripperState
    contacts: Contacts | None = None


@dataclass(frozen=True, kw_only=True)
class TravelRule:
    """How the arm has to stand before the base moves.

    frame: of the hand. height: above the floor, at most [m]. reach: from the origin of the base,
    at most [m].
    """

    robot: RobotModel
    frame: str
    height: float
    reach: float

    def check(self, q: Vector) -> None:
        """Raise Refused where the hand is too high or too far out at q, shape (n,) [rad]."""
        place = self.robot.frame_pose(q, self.frame).translation
        if place[2] > self.height:
            raise Refused(
                "too_high",
                f"{self.frame} is {place[2]:.3f} m above the floor; the base moves only below "
                f"{self.height:g} m",
            )
        reach = math.hypot(place[0], place[1])
        if reach > self.reach:
            raise Refused(
                "too_far",
                f"{self.frame} reaches {reach:.3f} m out from the base, which moves only below "
                f"{self.reach:g} m",
            )


@dataclass(frozen=True, kw_only=True)
class _Retreat:
    """Going back from a collision: what the goal fails with then, unless it goes on elsewhere."""

    failure: Outcome
    collision: Collision
    goes_on: bool


@dataclass(kw_only=True)
class _Task:
    """The goal under way.

    retreat: while the robot goes back from what it has touched. replans: how often it was given
    another way. close: what is nearest while it stands and waits for its way. arm_rests: of kind
    `stop`.
    """

    goal: Goal
    part: Part
    told: bool = False
    retreat: _Retreat | None = None
    replans: int = 0
    close: tuple[str, str] | None = None
    arm_rests: bool = False


@dataclass(frozen=True, kw_only=True)
class Evasion:
    """What is done about things that come into the way.

    back_off: how far the robot goes back from what it has touched [m]. stop_within: an arm on a
    planner's way stops where something is closer [m]; it has to be less than what the planner
    leaves. replans: how often a goal may be given another way.
    """

    back_off: float = 0.05
    stop_within: float = 0.004
    replans: int = 3


class Dispatcher:
    """Carries out one goal at a time; a new one ends the one before.

    monitor: None: contacts are not looked at. In each step: `look`, then `begin` where there is a
    new goal, then the commands of the parts.
    """

    def __init__(
        self,
        arm: Manipulator,
        base: BaseMotion,
        hand: Grip,
        travel: TravelRule,
        *,
        monitor: CollisionMonitor | None = None,
        evasion: Evasion | None = None,
    ) -> None:
        self._arm, self._base, self._hand = arm, base, hand
        self._travel = travel
        self._monitor = monitor
        self._evasion = evasion or Evasion()
        self._lost = ""
        self._news: deque[GoalStatus] = deque()
        self._warnings: list[str] = []
        self._task: _Task | None = None
        self._sensed: Sensed | None = None
        self._touched: tuple[str, str] | None = None
        self._is_slow = False

    def news(self) -> GoalStatus | None:
        """Return the next status nobody has been told of, if there is one."""
        return self._news.popleft() if self._news else None

    def warnings(self) -> list[str]:
        """Return the sentences that were not told yet."""
        told, self._warnings = self._warnings, []
        return told

    def hold(self, sensed: Sensed) -> None:
        """Stand still, as everything stands when it all begins."""
        self._sensed = sensed
        self._arm.hold(sensed.q)
        self._base.hold(sensed.base)
        self._hand.hold(sensed.hand)

    def begin(self, goal: Goal, t: float) -> None:
        """Take in a goal at a time [s]; what is wrong with it becomes its status."""
        if self._task is not None:
            text = f"goal {goal.id} came before it was done"
            self._tell(self._task.goal.id, "cancelled", text=text)
        part = _PARTS[goal.type]
        self._touched, self._is_slow = None, False
        self._rest_all(t, but=part)
        if self._monitor is not None:
            self._monitor.begin(goal.touches, grips=goal.type == "grip", moves=_MOVES[part])
        try:
            text = self._begin(goal, part, t)
        except RunError as exc:
            cause = exc.cause if isinstance(exc, Refused) else "invalid"
            self._tell(goal.id, "failed", cause, str(exc))
            self._rest_all(t)
            self._task = None
            return
        self._tell(goal.id, "accepted", text=text)
        self._task = _Task(goal=goal, part=part)

    def _begin(self, goal: Goal, part: Part, t: float) -> str:
        now = self._now()
        if self._lost and part != "all":
            raise Refused("no_plan", self._lost)
        if part == "arm":
            return self._arm.begin(goal, now.q, now.base, t, held=self._held())
        if part == "base":
            self._travel.check(now.q)
            return self._base.begin(goal, now.base)
        if part == "hand":
            return self._hand.begin(goal, t)
        self._arm.stop(t)
        return "stop"

    def lose_planner(self, text: str, t: float) -> None:
        """Stop and fail, now and from now on: there are no plans any more."""
        if self._lost:
            return
        self._lost = text
        task = self._task
        if task is not None and task.part != "all":
            self._rest_all(t)
            self._end(task, Outcome(state="failed", cause="no_plan", text=text))

    def _held(self) -> str:
        return self._monitor.held if self._monitor is not None else ""

    def _rest_all(self, t: float, but: Part | None = None) -> None:
        """Bring to rest what the goal before has set in motion; but: not this part."""
        part = self._task.part if self._task is not None else None
        if part is None or part == but:
            return
        if part == "arm":
            self._arm.stop(t)
        elif part == "base":
            self._base.stop()
        elif part == "hand":
            self._hand.stop()

    def look(self, sensed: Sensed, t: float, dt: float) -> None:
        """Take in what was measured at a time [s], dt after the step before [s]."""
        self._sensed = sensed
        watch = self._watch(sensed, dt)
        scale = watch.scale if watch is not None else 1.0
        self._arm.advance(dt, scale)
        self._base.advance(dt, scale)
        ends: dict[Part, Outcome | None] = {
            "arm": self._arm.look(sensed.q, sensed.v, t),
            "base": self._base.look(sensed.base),
            "hand": self._hand.look(sensed.hand, t),
        }
        collision = self._new_collision(watch)
        lost = self._hand.lost(t)
        task = self._task
        if task is None:
            self._warn(str(collision) if collision is not None else "", lost)
            return
        if not task.told:
            task.told = True
            self._tell(task.goal.id, "running")
        if task.part == "all":
            self._warn(lost)
            self._look_stopping(task, ends["arm"])
        elif task.retreat is not None:
            self._warn(lost)
            self._look_backing_off(task, task.retreat, ends[task.part], collision, t)
        elif collision is not None:
            self._collide(task, collision, t)
        elif lost:
            self._rest_all(t)
            self._end(task, Outcome(state="failed", cause="slipped", text=lost))
        elif hindrance := self._hindrance(task, watch):
            self._replan(task, hindrance, t)
        else:
            end = ends[task.part]
            if end is not None:
                self._end(task, end)

    def _hindrance(self, task: _Task, watch: Watch | None) -> str:
        """Return what is in the way that the arm goes by a plan; empty: nothing."""
        if task.part != "arm":
            return ""
        near = watch.near if watch is not None else None
        if not self._arm.follows_plan:
            task.close = near
            return ""
        if self._arm.blocked:
            return self._arm.blocked
        if watch is None or near is None or near == task.close:
            return ""
        if watch.gap >= self._evasion.stop_within:
            return ""
        ours, other = near
        return f"{ours} is {watch.gap * 1e3:.0f} mm from {other}"

    def _replan(self, task: _Task, why: str, t: float) -> None:
        """Stop and ask for another way; the goal fails where that was done too often."""
        most = self._evasion.replans
        if task.replans == most:
            ways = f", after {most} other way{'s' if most > 1 else ''}" if most else ""
            text = f"{why}; stopped{ways}"
            self._rest_all(t)
            self._end(task, Outcome(state="failed", cause="no_way", text=text))
            return
        task.replans += 1
        try:
            self._arm.replan(t)
        except RunError as exc:
            self._rest_all(t)
            self._end(task, Outcome(state="failed", cause="no_way", text=f"{why}; stopped; {exc}"))
            return
        if self._monitor is not None:
            self._monitor.begin(task.goal.touches, moves=_MOVES[task.part])
        text = f"{why}; stopped, asked for another way ({task.replans} of {most})"
        self._tell(task.goal.id, "running", text=text)
        self._warn(text)

    def _watch(self, sensed: Sensed, dt: float) -> Watch | None:
        """Return what the monitor sees; say when the robot begins to slow down."""
        if self._monitor is None or sensed.contacts is None:
            return None
        watch = self._monitor.look(sensed.contacts, holding=sensed.hand.holding, dt=dt)
        is_slow = watch.near is not None
        if is_slow and not self._is_slow and self._task is not None and watch.near is not None:
            ours, other = watch.near
            self._warn(f"{ours} is {watch.gap * 1e3:.0f} mm from {other}: slower")
        self._is_slow = is_slow
        return watch

    def _new_collision(self, watch: Watch | None) -> Collision | None:
        """Return a collision when it begins; the same one is told once for each goal."""
        collision = watch.collision if watch is not None else None
        pair = collision.pair if collision is not None else None
        is_old, self._touched = pair == self._touched, pair
        return None if is_old else collision

    def _look_stopping(self, task: _Task, end: Outcome | None) -> None:
        if end is not None and end.state == "failed":
            self._end(task, end)
            return
        task.arm_rests = task.arm_rests or end is not None
        if task.arm_rests and not self._base.is_moving:
            self._end(task, Outcome(state="succeeded", text="all is at rest"))

    def _collide(self, task: _Task, collision: Collision, t: float) -> None:
        """Stop, go back the way the robot came, and fail when that is done."""
        text = f"{collision}; stopped"
        if task.part == "hand":
            self._hand.stop()
            self._end(task, Outcome(state="failed", cause="collision", text=text))
            return
        may_go_on = task.part == "arm" and self._arm.follows_plan
        way = self._go_back(task.part, t)
        goes_on = may_go_on and way > 0.0 and task.replans < self._evasion.replans
        text = f"{text}, went back {way * 1e3:.0f} mm" if way > 0.0 else text
        failure = Outcome(state="failed", cause="collision", text=text)
        task.retreat = _Retreat(failure=failure, collision=collision, goes_on=goes_on)
        if self._monitor is not None:
            self._monitor.begin(task.goal.touches, moves=_MOVES[task.part])

    def _go_back(self, part: Part, t: float) -> float:
        """Begin to go back; return how far [m]."""
        if part == "base":
            return self._base.back_off(self._evasion.back_off)
        try:
            return self._arm.back_off(t, self._evasion.back_off)
        except RunError:
            # There is no way back to go, or none within the limits.
            self._arm.stop(t)
            return 0.0

    def _look_backing_off(
        self,
        task: _Task,
        retreat: _Retreat,
        end: Outcome | None,
        collision: Collision | None,
        t: float,
    ) -> None:
        stands = task.part == "base" and not self._base.is_moving
        is_other = collision is not None and collision.pair != retreat.collision.pair
        if not is_other and end is None and not stands:
            return
        if is_other:
            self._rest_all(t)
            self._warn(f"on the way back {collision}")
        elif retreat.goes_on and end is not None and end.state == "succeeded":
            task.retreat = None
            self._replan(task, retreat.failure.text, t)
            return
        self._end(task, retreat.failure)

    def _end(self, task: _Task, outcome: Outcome) -> None:
        self._tell(task.goal.id, outcome.state, outcome.cause, outcome.text)
        self._task = None

    def _warn(self, *texts: str) -> None:
        self._warnings += [text for text in texts if text]

    def _tell(self, number: int, state: GoalState, cause: str = "", text: str = "") -> None:
        self._news.append(GoalStatus(id=number, state=state, cause=cause, text=text))

    def _now(self) -> Sensed:
        if self._sensed is None:
            raise RunError("nothing has been measured yet")
        return self._sensed
