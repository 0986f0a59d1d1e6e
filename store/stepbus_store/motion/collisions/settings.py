"""What a robot may touch, and how fast it may move near everything else."""

import math
from dataclasses import dataclass

_WARY = 0.25
"""Share of `creep` at which the arm creeps near what has stopped it before."""


@dataclass(frozen=True, kw_only=True)
class MonitorSettings:
    """What a robot may touch, and how it slows down near everything else.

    links: of the robot; base_links: those that only the base moves, not the arm. pads: those that
    may touch the goal's `touches` and what is held. ignore: wheels and casters, which may touch
    what they stand on at the start. force: above it a touch is a collision [N]. more_force: the
    same, on top of the force at the start of the goal [N].
    within: below this distance the arm slows down [m]. brake: of any link, when the arm slows down
    [m/s²]. reaction: until that has begun [s]. clearance: what the arm stops before [m]. creep:
    slowest speed near things [m/s]. checks_itself: every motion is checked for collisions of the
    robot's links with each other before it starts, so that they do not slow it down. halt: below it
    nothing may come closer to a base [m]. range: of the contacts [m]. stop, stop_holding: of any
    link in the hardest stop, without and with something in the gripper [m/s²].
    """

    links: frozenset[str]
    pads: tuple[str, str]
    base_links: frozenset[str] = frozenset()
    ignore: frozenset[str] = frozenset()
    force: float = 0.5
    more_force: float = 5.0
    within: float = 0.08
    brake: float = 1.0
    reaction: float = 0.05
    clearance: float = 2e-3
    creep: float = 0.02
    checks_itself: bool = False
    halt: float = 5e-3
    range: float = math.inf
    stop: float = 8.0
    stop_holding: float = 5.0

    def safe_speed(self, gap: float, *, wary: bool = False) -> float:
        """Return the largest speed of a link that can still stop within a gap [m, m/s].

        The path of reaction and braking, v·t + v²/2a, ends at `clearance` (speed and separation
        monitoring: ISO/TS 15066, 2016, section 5.5.4). wary: of what has stopped the arm before.
        """
        return max(self._speed(self.brake, gap), self.creep * (_WARY if wary else 1.0))

    def unseen_speed(self, *, holding: bool) -> float:
        """Return the largest speed of a link beside space that the contacts do not reach [m/s].

        What stands just beyond their range can still be stopped before.
        """
        return self._speed(self.stop_holding if holding else self.stop, self.range)

    def stopping(self, speed: float, *, holding: bool) -> float:
        """Return how far a link goes in the hardest stop from a speed [m, m/s]."""
        brake = self.stop_holding if holding else self.stop
        return speed * self.reaction + speed**2 / (2.0 * brake)

    def _speed(self, brake: float, gap: float) -> float:
        before, room = brake * self.reaction, max(gap - self.clearance, 0.0)
        return math.sqrt(before**2 + 2.0 * brake * room) - before
