"""The actions of a script: changes of the world at given times of a run."""

from collections.abc import Iterator

import msgspec

from stepbus_participant import Settings, Vector3
from stepbus_participant.parameters import Keys, Pause

_SUBJECTS = {
    "body": ("position", "orientation_rpy"),
    "jam": (),
    "camera": ("off",),
}
"""Subject of an action → the keys that go with it."""


class Action(Settings):
    """One action: a body moves, a joint jams, or a camera fails."""

    at_ns: Pause
    """Simulation time, e.g. `6s`; executed at the first step that is not before it."""
    body: str | None = None
    """Body that jumps to `position`, at rest."""
    position: Vector3 | None = None
    """New position of the body's frame in the world frame [m]."""
    orientation_rpy: Vector3 | None = None
    """Its roll, pitch, yaw about fixed axes [rad]. Default: unchanged."""
    jam: str | None = None
    """Joint that stays at its position from then on, whatever the commands."""
    camera: str | None = None
    """Camera that stops taking images."""
    off: bool | None = None
    """Whether the camera is off; false: it resumes. Default: true."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield contradictions among the keys."""
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
