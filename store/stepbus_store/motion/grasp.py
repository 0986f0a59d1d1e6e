"""What the pads of a gripper hold, as its contacts show."""

from stepbus_schemas import Contacts
from stepbus_store.motion.sensed import MonitorSettings

_APART = 5e-3
"""Distance from which a thing that was between the pads counts as let go [m]."""


class Grasp:
    """Follows what is between the pads, from step to step.

    held: link of the world between them; empty: none. stood_on: what that touched when it was
    taken. around: links of the robot that were near it then. between: what is or was between the
    pads, until they have let go of it.
    """

    def __init__(self, settings: MonitorSettings) -> None:
        self._settings = settings
        self.held = ""
        self.stood_on: set[str] = set()
        self.around: set[str] = set()
        self.between: set[str] = set()

    def update(self, contacts: Contacts, *, holding: bool, grips: bool) -> None:
        """Take the contacts of a step.

        holding: whether the gripper holds something between its pads. grips: whether the goal
        under way moves them.
        """
        touched = {pad: _touched_by(contacts, pad) for pad in self._settings.pads}
        close = {link for pad in self._settings.pads for link in _near(contacts, pad, _APART)}
        one, other = (touched[pad] for pad in self._settings.pads)
        if grips:
            self.between |= set(one) | set(other)
        self.between &= close
        both = [link for link in one if link in other]
        if holding and both and self.held not in both:
            self.held = both[0]
            near = set(_near(contacts, self.held, self._settings.within))
            self.around = near & self._settings.links
            self.stood_on = set(_near(contacts, self.held, 1e-3)) - self._settings.links
        elif not holding and self.held and self.held not in both:
            self.between.add(self.held)
            self.held, self.stood_on, self.around = "", set(), set()


def _touched_by(contacts: Contacts, link: str) -> list[str]:
    """Return what presses on a link, the hardest first."""
    rows = zip(contacts.pairs, contacts.force, strict=True)
    touching = [
        (-force, _other(pair, link)) for pair, force in rows if link in pair and force > 0.0
    ]
    return [name for _, name in sorted(touching)]


def _near(contacts: Contacts, link: str, within: float) -> list[str]:
    rows = zip(contacts.pairs, contacts.distance, strict=True)
    return [_other(pair, link) for pair, gap in rows if link in pair and gap < within]


def _other(pair: tuple[str, str], link: str) -> str:
    return pair[1] if pair[0] == link else pair[0]
