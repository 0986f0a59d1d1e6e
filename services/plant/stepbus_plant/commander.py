"""Takes the commands of one input to the joints they are for, and refuses what cannot work."""

from __future__ import annotations

import math
from collections.abc import Sequence

from stepbus.settings import nearest
from stepbus_schemas import JointCommand

from .drives import Drive
from .errors import CommandError
from .joints import Joint
from .physics import Physics

_EXTRAS = {
    "torque": (),
    "velocity": ("effort_limit",),
    "position": ("velocity", "effort_limit"),
    "teleport": ("velocity",),
}
"""The vectors that a mode takes beside `values`."""


class Commander:
    """Carries out the commands of one input; there may be one for each arm, or finger.

    port: its name, for messages. names: whose values its vectors hold, in their order. owners:
    joint → the input that drives it; shared by all commanders of a plant.
    Raises CommandError when names are unknown or stand there twice.
    """

    def __init__(
        self,
        port: str,
        names: Sequence[str],
        *,
        physics: Physics,
        drives: Sequence[Drive],
        owners: dict[str, str],
    ) -> None:
        self._port = port
        self._physics = physics
        self._owners = owners
        self._owns = False
        places = self._places(names, [joint.name for joint in physics.joints])
        rows = [
            (drive, [(i, places[j.name]) for i, j in enumerate(drive.joints) if j.name in places])
            for drive in drives
        ]
        self._rows = [(drive, pairs) for drive, pairs in rows if pairs]
        joints = {joint.name: joint for joint in physics.joints}
        self._joints = [joints[name] for name in names]

    def _places(self, names: Sequence[str], known: Sequence[str]) -> dict[str, int]:
        """Return where each joint stands in the vectors."""
        mistakes = [f"joint {n!r} is unknown; {nearest(n, known)}" for n in names if n not in known]
        mistakes += [f"joint {n!r} stands there twice" for n in set_of(names, twice=True)]
        if mistakes:
            raise CommandError("\n".join(f"input {self._port!r}: {text}" for text in mistakes))
        return {name: place for place, name in enumerate(names)}

    def apply(self, command: JointCommand) -> None:
        """Carry out a command from now on; nothing of it is done when any of it is refused.

        Raises CommandError for a vector of the wrong length, a value that is no number, a mode
        that a joint does not take, a vector the mode does not take, a teleport beyond a stop, or a
        joint that another input drives.
        """
        self._check(command)
        if command.mode == "teleport":
            self._teleport(command)
            return
        if not self._owns:
            self._claim()
        for drive, rows in self._rows:
            drive.take(command, rows)

    def _check(self, command: JointCommand) -> None:
        ...
