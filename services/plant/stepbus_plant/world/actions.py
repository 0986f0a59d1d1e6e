"""What a script may say: what happens to the world in a run, and when."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from stepbus_participant import Settings, Vector3
from stepbus_participant.parameters import Keys, Pause

_SUBJECTS = {
    "body": ("position", "orientation_rpy"),
    "jam": (),
    "camera": ("off",),
}
"""What an action happens to, and the keys that go with it."""


class Action(Settings):
    """One thing that happens: a body is put somewhere, a joint jams, or a camera fails."""

    at_ns: Pause
    """Simulation time, e.g. `6s`; carried out at the first step that is not before it."""
    body: str | None = None
    """Body that is at once somewhere else, at rest."""
    position: Vector3 | None = None
    """Where the body's frame then is, in the frame of the world [m]."""
    orientation_rpy: Vector3 | None = None
    """Its roll, pitch, yaw about fixed axes [rad]. Default: as it was."""
    jam: str | None = None
    """Joint that stands still from then on, whatever it is commanded."""
    camera: str | None = None
    """Camera that gives no images any more."""
    off: bool | None = None
    """Whether the camera is off; false: it is on again. Default: true."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield what is wrong among keys that are fine one by one."""
        given = [key for key, value in msgspec.structs.asdict(self).items() if value is not None]
        subjects = [key for key in _SUBJECTS if key in given]
        if len(subjects) != 1:
            yield (
                (),
                f"needs one of {', '.join(_SUBJECTS)}, it has {' and '.join(subjects) or 'none'}",
            )
            return
        subject = subjects[0]
        for key in given:
            if key not in ("at_ns", subject, *_SUBJECTS[subject]):
                yield (key,), f"has no meaning beside {subject!r}"
        if subject == "body" and self.position is None:
            yield (), "'position' is missing"
