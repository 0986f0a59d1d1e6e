"""An arm that has stopped before something: it goes back the way it came."""

from stepbus_store.motion.collisions.findings import Approach, Collision
from stepbus_store.motion.goals.outcome import Outcome
from stepbus_store.motion.goals.parts import Parts

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
        return Outcome(state="failed", cause="no_path", text=f"{self.text}{behind}")
