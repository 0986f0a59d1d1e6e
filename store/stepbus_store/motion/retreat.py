"""How an arm, or a base, gets away from what it has touched."""

from stepbus_schemas import BaseState, Goal
from stepbus_store.cause import Cause
from stepbus_store.motion.base_motion import BaseMotion
from stepbus_store.motion.monitor import CollisionMonitor
from stepbus_store.motion.outcome import Outcome
from stepbus_store.motion.parts import Parts
from stepbus_store.motion.sensed import Approach, Collision

_ROOM = 0.02
"""An arm that stands farther than this from what it has stopped for need not leave it [m]."""


class ArmRetreat:
    """Stops an arm before something, and backs it off, so that it has room for another path.

    The path so far was free; what comes close on it all the same ends the retreat. why: a sentence
    about what is close. distance: of the tip [m]. is_urgent: it stops harder than it can hold
    something.
    """

    def __init__(
        self, parts: Parts, near: Approach, why: str, distance: float, t: float, *, is_urgent: bool
    ) -> None:
        self._parts = parts
        self._near = near
        self._why = why
        self._distance = distance
        self._length: float | None = None
        parts.arm.stop(t, touches=is_urgent, keeps_route=True)

    @property
    def text(self) -> str:
        """Return what has happened, as a sentence."""
        went = f", backed off {self._length * 1e3:.0f} mm" if self._length else ""
        return f"{self._why}; stopped{went}"

    @property
    def other(self) -> str:
        """Return the link that it has stopped for."""
        return self._near.other

    @property
    def leaves(self) -> bool:
        """Return whether it goes back; before, it stops."""
        return self._length is not None

    def is_over(self, end: Outcome, gap: float, t: float) -> bool:
        """Return whether the arm has room; it goes back where it has not.

        end: of the motion under way. gap: to what it has stopped for [m].
        """
        if self._length is None and end.state == "succeeded" and gap < _ROOM:
            self._length = self._parts.back_off_arm(t, self._distance)
            return False
        return True

    def failure(self, obstacle: Approach | Collision | None = None) -> Outcome:
        """Return the end of the goal; obstacle: what ended the retreat."""
        behind = f"; while backing off, {obstacle}" if obstacle is not None else ""
        return Outcome(state="failed", cause=Cause.NO_PATH, text=f"{self.text}{behind}")


class BaseBackOff:
    """Backs a base off from a collision, and measures how far that went.

    The wheels are locked until the base stands; then it goes back by `distance` [m] along the
    segment under way, or less, if it comes close to something else; 0: it stays.
    """

    def __init__(
        self,
        base: BaseMotion,
        monitor: CollisionMonitor,
        goal: Goal,
        collision: Collision,
        distance: float,
    ) -> None:
        self._base = base
        self._monitor = monitor
        self._goal = goal
        self._collision = collision
        self._start: BaseState | None = None
        self._obstacle = ""
        base.halt()
        self._goes_back = distance > 0.0 and base.back_off(distance)

    def check(self, collision: Collision | None) -> Outcome | None:
        """Return the end of the goal once the base stands; collision: one that has just started."""
        if self._base.is_halting:
            return None
        if self._start is None:
            self._start = self._base.state
            self._monitor.start(self._goal.touches, moves="base")
        elif not self._obstacle:
            self._look_back(collision)
        if self._base.is_moving:
            return None
        text = f"{self._collision}; stopped{self._measured(self._start)}"
        return Outcome(state="failed", cause=Cause.COLLISION, text=text)

    def _look_back(self, collision: Collision | None) -> None:
        """Halt for what comes close while the base goes back."""
        near = self._monitor.approach(besides=self._collision.pair)
        if collision is not None:
            self._obstacle = f"then {collision}"
        elif near is not None:
            self._obstacle = f"then {near} behind it"
        if self._obstacle:
            self._base.halt()

    def _measured(self, start: BaseState) -> str:
        force, gap = self._monitor.touch(self._collision.pair)
        length = self._base.travelled(start)
        went = f", backed off {length * 1e3:.0f} mm by odometry" if self._goes_back else ""
        if force > 0.0:
            now = f"still touches it with {force:.1f} N"
        elif gap is None:
            now = "nothing is near it"
        else:
            now = f"now {gap * 1e3:.1f} mm from it"
        return f"{went}{', ' if self._obstacle else ''}{self._obstacle}, {now}"
