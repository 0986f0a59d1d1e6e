"""How the arm must be stowed before the base moves."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from msgspec.structs import replace

from stepbus_kinematics import RobotModel, Vector
from stepbus_schemas import Goal, RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.manipulator import Manipulator
from stepbus_store.motion.outcome import Measured, Outcome, Refused


@dataclass(frozen=True, kw_only=True)
class StowCondition:
    """How the arm must be stowed before the base moves.

    frame: of the gripper. height: above the floor, at most [m]. reach: from the origin of the
    base, at most [m].
    """

    robot: RobotModel
    frame: str
    height: float
    reach: float

    def check(self, q: Vector) -> None:
        """Raise Refused where the frame is too high or too far out at q, shape (n,) [rad]."""
        position = self.robot.frame_pose(q, self.frame).translation
        if position[2] > self.height:
            raise Refused(
                Cause.TOO_HIGH,
                f"{self.frame} is {position[2]:.3f} m above the floor; the base moves only below "
                f"{self.height:g} m",
            )
        reach = math.hypot(position[0], position[1])
        if reach > self.reach:
            raise Refused(
                Cause.TOO_FAR,
                f"{self.frame} reaches {reach:.3f} m out from the base, which moves only below "
                f"{self.reach:g} m",
            )


_BACK = 0.1
"""How far the arm goes back along the path it came [m]."""

_UP = (0.05, 0.15)
"""How far it rises [m]."""

_IN = 0.1
"""How far it draws its tip in towards the base [m]."""

_Escape = tuple[str, Callable[[Measured, float], object]]
"""What an escape is called, and what starts it."""


@dataclass(kw_only=True)
class BackToRest:
    """Plans a path to the joints of a goal, or to its pose; if there is none, frees the arm first.

    It frees it by going back along the path it came, then straight up, then towards the base: short
    motions that are checked, but may start where something touches. After each it plans again.
    """

    goal: Goal
    held: str
    arm: Manipulator
    escapes: list[_Escape] = field(init=False)
    done: list[str] = field(default_factory=list)
    is_freeing: bool = False
    problem: str = ""

    def __post_init__(self) -> None:
        self.escapes = self._escapes()

    def start(self, now: Measured, t: float) -> str:
        """Start the path to where the arm rests, or to free it; raises Refused."""
        try:
            return self._plan(now, t)
        except RunError as exc:
            self.problem = str(exc)
            if not self._free(now, t):
                raise
            return f"freeing the arm first: {self.problem}"

    def follow(self, end: Outcome, now: Measured, t: float) -> Outcome | None:
        """Return how the goal ended, once nothing is left to be tried; end: of a motion."""
        if end.state == "succeeded":
            if not self.is_freeing:
                before = f"after going {', '.join(self.done)}; " if self.done else ""
                return Outcome(state="succeeded", text=f"back at rest; {before}{end.text}")
            try:
                self._plan(now, t)
            except RunError as exc:
                self.problem = str(exc)
            else:
                return None
        elif not self.is_freeing:
            self.problem = end.text
        if self._free(now, t):
            return None
        tried = f", after going {', '.join(self.done)}" if self.done else ""
        text = f"no path back to rest{tried}: {self.problem}"
        return Outcome(state="failed", cause=Cause.NO_PATH, text=text)

    def _plan(self, now: Measured, t: float) -> str:
        self.is_freeing = False
        goal = replace(self.goal, type="move_joints" if self.goal.joints else "move_to_pose")
        return self.arm.start(goal, now.q, now.base, t, held=self.held)

    def _free(self, now: Measured, t: float) -> bool:
        """Start the next motion that frees the arm; return False where none is left."""
        while self.escapes:
            name, start = self.escapes.pop(0)
            try:
                start(now, t)
            except RunError:
                continue
            self.done.append(name)
            self.is_freeing = True
            return True
        return False

    def _escapes(self) -> list[_Escape]:
        ups = [(f"{up:g} m up", partial(self._line, inwards=0.0, up=up)) for up in _UP]
        inwards = f"{_IN:g} m in", partial(self._line, inwards=_IN, up=_UP[0])
        return [("back", self._back), *ups, inwards]

    def _back(self, _: Measured, t: float) -> None:
        self.arm.back_off(t, _BACK)

    def _line(self, now: Measured, t: float, *, inwards: float, up: float) -> None:
        """Start a straight line of the tip: towards the base, and up [m]."""
        position, turn = self.arm.links.tip_pose(now.q)
        x, y, z = position
        away = max((x * x + y * y) ** 0.5, 1e-9)
        share = max(1.0 - inwards / away, 0.0)
        goal = replace(
            self.goal,
            type="move_linear",
            joints=[],
            values=[],
            tip=self.arm.tip,
            frame="",
            position=(x * share, y * share, z + up),
            orientation=turn,
        )
        self.arm.start(goal, now.q, now.base, t, held=self.held)
