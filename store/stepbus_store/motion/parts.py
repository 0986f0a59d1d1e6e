"""The parts of a robot, and which of them carries out a goal."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from stepbus_kinematics import Vector
from stepbus_schemas import Goal, GoalType, RunError
from stepbus_store.cause import Cause
from stepbus_store.motion.base_motion import BaseMotion
from stepbus_store.motion.gripper import Gripper, Scale
from stepbus_store.motion.manipulator import Manipulator
from stepbus_store.motion.monitor import Moves
from stepbus_store.motion.navigator import Navigator
from stepbus_store.motion.outcome import Measured, Outcome, Refused

Part = Literal["arm", "base", "gripper", "all"]
Ends = dict[Part, Outcome | None]

PART_OF: Mapping[GoalType, Part] = {
    "move_joints": "arm",
    "move_to_pose": "arm",
    "move_linear": "arm",
    "spiral": "arm",
    "back_to_rest": "arm",
    "drive": "base",
    "turn": "base",
    "go_to": "base",
    "go_together": "base",
    "grip": "gripper",
    "stop": "all",
}
"""Which part of the robot carries out a goal."""

MOVES: Mapping[Part, Moves] = {"arm": "arm", "gripper": "arm", "base": "base", "all": "all"}
"""What the collision monitor must expect to move."""


@dataclass(frozen=True, kw_only=True)
class Parts:
    """The parts of a robot; None: it has none.

    navigator: plans routes of the base; None: it drives straight. check_stowed: raises Refused
    where the base must not move. scale: weighs what the gripper holds.
    """

    arm: Manipulator
    base: BaseMotion | None = None
    navigator: Navigator | None = None
    gripper: Gripper | None = None
    check_stowed: Callable[[Vector], None] | None = None
    scale: Scale | None = None

    def hold(self, now: Measured) -> None:
        """Stand still."""
        self.arm.hold(now.q)
        if self.base is not None:
            self.base.hold(now.base)
        if self.gripper is not None:
            self.gripper.hold(now.gripper)

    def interrupt(self, now: Measured) -> None:
        """Give up all motions: something else brings the robot to rest; the gripper holds on."""
        self.arm.hold(now.q)
        if self.navigator is not None:
            self.navigator.cancel()
        if self.base is not None:
            self.base.interrupt(now.base)
        if self.gripper is not None:
            self.gripper.interrupt(now.gripper)

    def start(self, part: Part, goal: Goal, now: Measured, t: float, held: str) -> str:
        """Start a goal at a time [s] and return a sentence; raises Refused."""
        match part:
            case "arm":
                return self.arm.start(goal, now, t, held=held)
            case "base" if self.base is not None:
                if self.check_stowed is not None:
                    self.check_stowed(now.q)
                if self.navigator is None:
                    if goal.type == "go_together":
                        raise Refused(Cause.INVALID, "go_together needs a planner")
                elif goal.type in {"go_to", "go_together"}:
                    return self.navigator.start(goal, held, t, now.base)
                else:
                    self.navigator.cancel()
                return self.base.start(goal, now.base)
            case "gripper" if self.gripper is not None:
                return self.gripper.start(goal, t)
            case "all":
                self.arm.stop(t)
                self.rest("base", t)
                return "stop"
        raise Refused(Cause.INVALID, f"this robot has no {part} for goals of type {goal.type}")

    def advance(self, dt: float, scale: float, gap: float) -> None:
        """Move on by dt [s]: the arm at a scale of 0 to 1, a base that could stop in a gap [m]."""
        self.arm.advance(dt, scale)
        if self.base is not None:
            self.base.advance(dt, gap)

    def secure(self, now: Measured, dt: float) -> None:
        """Grip what is held as hard as it needs, and move with its weight; dt: as `advance`."""
        gripper, scale = self.gripper, self.scale
        if gripper is None or scale is None:
            return
        if not gripper.holds:
            scale.clear()
        elif now.effort is not None and self.base_rests():
            scale.weigh(now.q, now.v, now.effort, dt)
        gripper.secure(scale.load)
        self.arm.carry(scale.load)

    def check(self, now: Measured, t: float) -> Ends:
        """Return how the goal of each part ended at a time [s], once it has."""
        ends: Ends = {"arm": self.arm.check(now.q, now.v, t)}
        if self.base is not None:
            end = self.base.check(now.base)
            ends["base"] = end if self.navigator is None else self.navigator.check(end, t)
        if self.gripper is not None:
            ends["gripper"] = self.gripper.check(now.gripper, t)
        return ends

    def lost(self, t: float) -> str:
        """Return a sentence once the gripper has lost what it held, else nothing."""
        return self.gripper.lost(t) if self.gripper is not None else ""

    def rest(self, part: Part, t: float, *, touches: bool = False) -> None:
        """Bring a part to rest at a time [s]; touches: the robot has touched something."""
        if part == "arm":
            self.arm.stop(t, touches=touches)
        elif part == "base" and self.base is not None:
            if self.navigator is not None:
                self.navigator.cancel()
            self.base.stop()
        elif part == "gripper" and self.gripper is not None:
            self.gripper.stop()

    def back_off_arm(self, t: float, distance: float) -> float:
        """Start to go back along the arm's path so far; return its length [m]."""
        try:
            return self.arm.back_off(t, distance)
        except RunError:
            # There is no path to go back along, or none within the limits.
            self.arm.stop(t, touches=True)
            return 0.0

    def base_rests(self) -> bool:
        """Return whether no base follows a reference that moves."""
        return self.base is None or not self.base.is_moving

    def base_stops(self) -> bool:
        """Return whether the base is brought to rest before it has arrived."""
        base, navigator = self.base, self.navigator
        held_up = navigator is not None and navigator.is_held_up and not navigator.drives
        return base is not None and (base.is_halting or (held_up and base.is_moving))
