"""How the arm must be stowed before the base moves."""

import math
from dataclasses import dataclass, field

from msgspec.structs import replace

from stepbus_kinematics import RobotModel, Vector
from stepbus_schemas import Goal, RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.manipulator import Manipulator
from stepbus_store.motion.mobile.params import Params
from stepbus_store.motion.outcome import Measured, Outcome, Refused


def check_stowed(robot: RobotModel, params: Params, q: Vector) -> None:
    """Raise Refused where the tip is too high or too far out for the base; q: shape (n,) [rad]."""
    x, y, z = robot.frame_pose(q, params.tip).translation
    if z > params.safe_height:
        text = f"{params.tip} is {z:.3f} m above the floor; the base moves only below"
        raise Refused(Cause.TOO_HIGH, f"{text} {params.safe_height:g} m")
    reach = math.hypot(x, y)
    if reach > params.safe_reach:
        text = f"{params.tip} reaches {reach:.3f} m out from the base, which moves only below"
        raise Refused(Cause.TOO_FAR, f"{text} {params.safe_reach:g} m")


_BACK = 0.1
"""How far the arm goes back along the path it came [m]."""

_ESCAPES = (
    ("back", None),
    ("0.05 m up", (0.0, 0.05)),
    ("0.15 m up", (0.0, 0.15)),
    ("0.1 m in", (0.1, 0.05)),
)
"""What an escape is called; how far it draws the tip in towards the base, and up [m]; None: it goes
back along the path it came."""


@dataclass(kw_only=True)
class BackToRest:
    """Plans a path to the joints of a goal, or to its pose; if there is none, frees the arm first.

    It frees it by going back along the path it came, then straight up, then towards the base: short
    motions that are checked, but may start where something touches. After each it plans again.
    """

    goal: Goal
    held: str
    arm: Manipulator
    tried: int = 0
    done: list[str] = field(default_factory=list)
    is_freeing: bool = False
    problem: str = ""

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
        return self.arm.start(goal, now, t, held=self.held)

    def _free(self, now: Measured, t: float) -> bool:
        """Start the next motion that frees the arm; return False where none is left."""
        for name, line in _ESCAPES[self.tried :]:
            self.tried += 1
            try:
                if line is None:
                    self.arm.back_off(t, _BACK)
                else:
                    self._line(now, t, *line)
            except RunError:
                continue
            self.done.append(name)
            self.is_freeing = True
            return True
        return False

    def _line(self, now: Measured, t: float, inwards: float, up: float) -> None:
        """Start a straight line of the tip: towards the base, and up [m]."""
        (x, y, z), turn = self.arm.links.tip_pose(now.q)
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
        self.arm.start(goal, now, t, held=self.held)
