"""A body that the script moves: evenly, whatever is in its way."""

from typing import NamedTuple

from stepbus_plant.engine import BASE, Engine
from stepbus_plant.geometry import Pose


class Blow(NamedTuple):
    """The first contact of such a body with another one; force: of its first substep [N]."""

    force: float
    one: tuple[int, int]
    other: tuple[int, int]


class MovingBody:
    """Moves from where it is to a pose, at constant velocities.

    seconds: how long it takes. blow: the first contact, once there was one.
    """

    def __init__(self, engine: Engine, body: int, goal: Pose, seconds: float) -> None:
        self._engine = engine
        self._body = body
        self._start, self._goal = engine.frame((body, BASE)), goal
        self._seconds = seconds
        self._elapsed = 0.0
        ends = zip(self._start[0], goal[0], strict=True)
        vx, vy, vz = ((b - a) / seconds for a, b in ends)
        self._velocity = (vx, vy, vz)
        self._spin = engine.geometry.spin_between(self._start[1], goal[1], seconds)
        self._touched = {contact.other for contact in engine.contacts(body)}
        self.blow: Blow | None = None

    @property
    def is_there(self) -> bool:
        """Return whether it has arrived, and stands."""
        return self._elapsed >= self._seconds

    def before_substep(self) -> None:
        """Put it where it is now."""
        share = min(self._elapsed / self._seconds, 1.0)
        frame = self._engine.geometry.between(self._start, self._goal, share)
        self._engine.put(self._body, frame, self._velocity, self._spin)

    def after_substep(self, seconds: float) -> None:
        """Move on, and look whether it has hit something that it did not touch before."""
        self._elapsed += seconds
        if self.blow is None:
            pressed = self._engine.contacts(self._body, are_pressed=True)
            new = [contact for contact in pressed if contact.other not in self._touched]
            if new:
                worst = max(new, key=lambda contact: contact.force)
                force = sum(contact.force for contact in new if contact.other == worst.other)
                self.blow = Blow(force, worst.one, worst.other)
        if self.is_there:
            self._engine.put(self._body, self._goal)
