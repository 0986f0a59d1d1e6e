"""Opens and closes a gripper, tells when that is done, and notices when it loses what it held."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stepbus_motion.goals.outcome import Outcome, Refused
from stepbus_schemas import Goal, GripperCommand, GripperState, RunError


@dataclass(frozen=True, kw_only=True)
class GripSettings:
    """When a gripper has done what it shall.

    widest: between the pads [m]. tolerance: of the width [m]. still: the width changes by no more
    while the fingers stand [m]. still_for: how long they have to stand for that [s]. patience: how
    long they may stand without having done anything [s]. hold_force: to keep the fingers where
    they are before the first goal [N].
    """

    widest: float = 0.1
    tolerance: float = 1e-3
    still: float = 2e-4
    still_for: float = 0.1
    patience: float = 0.5
    hold_force: float = 15.0


class Grip:
    """Carries out goals of type `grip`, one at a time.

    A goal is done when the width is reached, or when the fingers stand because they hold
    something between them.
    """

    def __init__(self, settings: GripSettings) -> None:
        self._settings = settings
        self._command: GripperCommand | None = None
        self._state: GripperState | None = None
        self._goal: GripperCommand | None = None
        self._anchor = 0.0
        self._still_since = 0.0
        self._began_at = 0.0
        self._holds_width: float | None = None
        self._loose_since: float | None = None

    @property
    def holds(self) -> bool:
        """Return whether the last goal ended with something between the pads, still there."""
        return self._holds_width is not None

    def hold(self, state: GripperState) -> None:
        """Keep the fingers where they are when it all begins."""
        self._state = state
        self._command = self._keep(state)

    def _keep(self, state: GripperState) -> GripperCommand:
        width = min(max(state.width, 0.0), self._settings.widest)
        return GripperCommand(width=width, force=self._settings.hold_force)

    def begin(self, goal: Goal, t: float) -> str:
        """Take in a goal at a time [s]; returns a sentence that says what will be done.

        Raises Refused for a width or force that cannot be.
        """
        state = self._now()
        if not 0.0 <= goal.width <= self._settings.widest:
            text = f"width {goal.width:g} m is out of reach (0 to {self._settings.widest:g} m)"
            raise Refused("invalid", text)
        if not (math.isfinite(goal.force) and goal.force >= 0.0):
            raise Refused("invalid", f"force {goal.force:g} N is no largest force")
        if goal.force == 0.0:
            raise Refused("no_force", "force is 0 N: the fingers would not move")
        self._goal = self._command = GripperCommand(width=goal.width, force=goal.force)
        self._anchor = self._began_at = state.width
        self._still_since = t
        self._holds_width = self._loose_since = None
        verb = "close" if goal.width < state.width else "open"
        return f"{verb} from {_mm(state.width)} to {_mm(goal.width)} with {goal.force:.1f} N"

    def stop(self) -> None:
        """Let the fingers stay where they are; what they hold they keep."""
        state = self._now()
        if self._goal is not None and state.holding:
            self._holds_width = state.width
        elif self._goal is not None:
            self._command = self._keep(state)
        self._goal = None

    def command(self) -> GripperCommand:
        """Return what the gripper shall do now."""
        if self._command is None:
            raise RunError("the gripper has not been measured yet")
        return self._command

    def look(self, state: GripperState, t: float) -> Outcome | None:
        """Take in what the gripper does at a time [s]; returns how the goal has ended, if so."""
        self._state = state
        if abs(state.width - self._anchor) > self._settings.still:
            self._anchor, self._still_since = state.width, t
        if self._goal is None:
            return None
        outcome = self._judge(self._goal, state, t - self._still_since)
        if outcome is not None:
            self._goal = None
        return outcome

    def _judge(self, goal: GripperCommand, state: GripperState, still: float) -> Outcome | None:
        is_still = still >= self._settings.still_for - 1e-9
        if is_still and state.holding:
            self._holds_width = state.width
            text = f"held: {_mm(state.width)} wide, {state.force:.1f} N"
            return Outcome(state="succeeded", text=text)
        if is_still and abs(state.width - goal.width) <= self._settings.tolerance:
            return Outcome(state="succeeded", text=f"{_mm(state.width)} wide, holds nothing")
        if still < self._settings.patience:
            return None
        moved = abs(state.width - self._began_at)
        did = "have not moved" if moved <= self._settings.still else f"stopped after {_mm(moved)}"
        text = (
            f"the fingers {did}: {_mm(state.width)} wide instead of {_mm(goal.width)}, "
            f"{state.force:.1f} N of {goal.force:.1f} N, nothing between them"
        )
        return Outcome(state="failed", cause="stuck", text=text)

    def lost(self, t: float) -> str:
        """Return what became of the thing that was held, when it has slipped out; or nothing.

        To be asked at every step; said once.
        """
        if self._holds_width is None or self._goal is not None:
            return ""
        state = self._now()
        if state.holding:
            self._loose_since = None
            return ""
        if self._loose_since is None:
            self._loose_since = t
        if t - self._loose_since < self._settings.still_for - 1e-9:
            return ""
        held, self._holds_width, self._loose_since = self._holds_width, None, None
        return (
            f"what was held at {_mm(held)} is gone: the pads are {_mm(state.width)} apart and "
            f"press with {state.force:.1f} N"
        )

    def _now(self) -> GripperState:
        if self._state is None:
            raise RunError("the gripper has not been measured yet")
        return self._state


def _mm(length: float) -> str:
    return f"{length * 1e3:.1f} mm"
