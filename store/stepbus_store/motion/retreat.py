"""How an arm, or a base, gets away from what it has touched."""

from dataclasses import InitVar, dataclass

from stepbus_schemas import BaseState, Goal
from stepbus_store.cause import Cause
from stepbus_store.motion.base_motion import BaseMotion
from stepbus_store.motion.monitor import CollisionMonitor
from stepbus_store.motion.outcome import Outcome
from stepbus_store.motion.sensed import Approach, Collision


@dataclass(kw_only=True)
class ArmRetreat:
    """An arm that goes back along its path, so that it has room for another one.

    left: the pair that has touched, or come close. why: a sentence about it. cause: of the goal's
    failure. may_replan: whether another path may follow. length: how far the arm goes back [m];
    None: it stops first. is_apart: whether the pair has been apart since.
    """

    left: Approach | Collision
    why: str
    cause: Cause
    may_replan: bool
    length: float | None = None
    is_apart: bool = False

    @property
    def text(self) -> str:
        """Return what has happened, as a sentence."""
        went = f", backed off {self.length * 1e3:.0f} mm" if self.length else ""
        return f"{self.why}; stopped{went}"

    def failure(self, obstacle: str = "") -> Outcome:
        """Return the end of the goal; obstacle: what ended the retreat."""
        behind = f"; while backing off, {obstacle}" if obstacle else ""
        return Outcome(state="failed", cause=self.cause, text=f"{self.text}{behind}")


@dataclass(kw_only=True)
class BaseBackOff:
    """Backs a base off from a collision, and measures how far that went.

    The wheels are locked until the base stands; then it goes back by `distance` [m] along the
    segment under way, or less, if it comes close to something else; 0: it stays.
    """

    base: BaseMotion
    monitor: CollisionMonitor
    goal: Goal
    collision: Collision
    distance: InitVar[float]
    goes_back: bool = False
    start: BaseState | None = None
    obstacle: str = ""

    def __post_init__(self, distance: float) -> None:
        self.base.halt()
        self.goes_back = distance > 0.0 and self.base.back_off(distance)

    def check(self, collision: Collision | None) -> Outcome | None:
        """Return the end of the goal once the base stands; collision: one that has just started."""
        if self.base.is_halting:
            return None
        if self.start is None:
            self.start = self.base.state
            self.monitor.start(self.goal.touches, moves="base")
        elif not self.obstacle:
            self._look_back(collision)
        if self.base.is_moving:
            return None
        text = f"{self.collision}; stopped{self._measured(self.start)}"
        return Outcome(state="failed", cause=Cause.COLLISION, text=text)

    def _look_back(self, collision: Collision | None) -> None:
        """Halt for what comes close while the base goes back."""
        near = self.monitor.approach(besides=self.collision.other)
        if collision is not None:
            self.obstacle = f"then {collision}"
        elif near is not None:
            self.obstacle = f"then {near} behind it"
        if self.obstacle:
            self.base.halt()

    def _measured(self, start: BaseState) -> str:
        force, gap = self.monitor.touch(self.collision.pair)
        length = self.base.travelled(start)
        went = f", backed off {length * 1e3:.0f} mm by odometry" if self.goes_back else ""
        if force > 0.0:
            now = f"still touches it with {force:.1f} N"
        elif gap is None:
            now = "nothing is near it"
        else:
            now = f"now {gap * 1e3:.1f} mm from it"
        return f"{went}{', ' if self.obstacle else ''}{self.obstacle}, {now}"
