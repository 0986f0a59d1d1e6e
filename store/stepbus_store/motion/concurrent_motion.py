"""A goal of the arm while the base drives: when it is planned, and when it moves."""

from dataclasses import dataclass, replace
from typing import Literal

from stepbus_schemas import BaseState, Goal, Point
from stepbus_store.motion.base_motion import BaseMotion
from stepbus_store.motion.manipulator import Manipulator
from stepbus_store.motion.navigator import Navigator
from stepbus_store.motion.outcome import Measured, Outcome, Refused

_LEAVES = 1.2
"""Length of the route along which the arm's path is checked, where both start together [m]."""

_ARRIVES = 0.8
"""The same at the end of a route, where the arm has to be there when the base is [m]."""

Phase = Literal["waits for a route", "asked", "postponed", "moves"]


@dataclass(kw_only=True)
class ConcurrentMotion:
    """Lets an arm move beside a base that drives, along a path that is free at all poses of both.

    A pose in the odometry frame is for the arrival: the arm starts on the last stretch of the
    route. Any other goal starts together with the base. Where there is no such path, the arm moves
    while the base stands: before it starts, or after it has arrived.

    In each step: `check`, as long as the base drives, then `follow` what became of the arm.
    """

    goal: Goal
    held: str
    arm: Manipulator
    base: BaseMotion
    navigator: Navigator
    phase: Phase = "waits for a route"

    @property
    def arrives(self) -> bool:
        """Return whether the arm has to be there when the base is."""
        return self.goal.frame == "odometry"

    def check(self, now: Measured, t: float) -> None:
        """Plan once the route is known, and move once that is safe; t: time [s]."""
        self.navigator.is_accompanied = True
        if self.phase == "waits for a route" and self.navigator.has_route:
            if self.arrives and self.navigator.is_detour:
                self.phase = "postponed"
            else:
                self._ask(now, t)
        elif self.phase == "asked" and self.arm.is_ready:
            if not self.arrives or (self.navigator.drives and self.base.remaining <= _ARRIVES):
                self._move()
        elif self.phase == "moves" and not (self.arrives or self.navigator.has_route):
            # Its path is free along the route that was.
            self.navigator.waits = True
        elif self.phase == "postponed" and not self.arrives and not self.base.is_moving:
            self._alone(now, t)

    def follow(self, end: Outcome | None, now: Measured, t: float) -> Outcome | None:
        """Return how the goal ended; end: of the arm's motion. Nothing is lost before it moves."""
        if self.phase == "moves":
            return end
        if end is not None and end.state == "failed":
            self.postpone(now, t)
        return None

    def postpone(self, now: Measured, t: float, *, is_urgent: bool = False) -> None:
        """Move while the base stands: before it drives on, or once it is there. Raises Refused.

        is_urgent: the arm stops harder than what it holds may need.
        """
        if self.arrives or self.base.is_moving:
            self.arm.stop(t, touches=is_urgent)
            self.phase = "postponed"
            if not self.arrives:
                self.navigator.pause()
        else:
            self._alone(now, t)

    def arrived(self, now: Measured, t: float) -> None:
        """Move on, since the base has arrived. Raises Refused."""
        if self.phase in {"waits for a route", "postponed"}:
            self._alone(now, t)
        elif self.phase == "asked":
            self._move()

    def leave(self, *, is_done: bool) -> None:
        """Drive the base on its own; unless the arm is done, it waits for another goal."""
        if is_done:
            self.navigator.go()
        self.navigator.wait_again()

    def _alone(self, now: Measured, t: float) -> None:
        self.phase = "moves"
        self.arm.start(self.goal, now, t, held=self.held)

    def _ask(self, now: Measured, t: float) -> None:
        there, bases = now, self._bases()
        if self.arrives and self.goal.base is not None:
            x, y, yaw = self.goal.base
            there = replace(now, base=BaseState(x=x, y=y, yaw=yaw, vx=0.0, wz=0.0))
        self.phase = "asked"
        try:
            self.arm.start(self.goal, there, t, held=self.held, bases=bases)
        except Refused:
            self.postpone(now, t)

    def _bases(self) -> list[Point]:
        """Return poses of the base at which the path has to be free; the last one plans it."""
        ahead = self.navigator.ahead()
        if self.arrives:
            return [pose for left, pose in ahead if left <= _ARRIVES]
        length = ahead[0][0]
        return [pose for left, pose in reversed(ahead) if length - left <= _LEAVES]

    def _move(self) -> None:
        self.phase = "moves"
        if self.arrives:
            self.navigator.may_detour = False
        else:
            self.navigator.go()
        self.arm.release()
