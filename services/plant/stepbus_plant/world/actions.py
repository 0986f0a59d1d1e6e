"""What a script may say: what happens to the world in a run, and when."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec

from stepbus_participant.durations import parse_duration
from stepbus_plant.checked import Problem, Vector3, find_problems
from stepbus_schemas import WiringError

_START = "0s"
_SUBJECTS = {
    "body": ("position", "orientation_rpy"),
    "jam": (),
    "camera": ("off",),
}
"""What an action happens to, and the keys that go with it."""


class Action(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One thing that happens: a body is put somewhere, a joint jams, or a camera fails."""

    at: str
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

    @property
    def at_ns(self) -> int:
        """Return its time [ns]."""
        return 0 if self.at == _START else parse_duration(self.at)


def action_problems(rows: Any) -> list[Problem]:
    """Return what is wrong with a script without knowing the world; rows: as in the scenario."""
    if not isinstance(rows, list | tuple):
        return [(("script",), "is no list of actions")]
    return [
        problem
        for number, row in enumerate(rows)
        for problem in (
            find_problems(row, Action, ("script", str(number)))
            or _contradictions(msgspec.convert(row, Action), ("script", str(number)))
        )
    ]


def _contradictions(action: Action, where: tuple[str, ...]) -> Iterator[Problem]:
    """Yield what is wrong among keys that are fine one by one."""
    given = [key for key, value in msgspec.structs.asdict(action).items() if value is not None]
    subjects = [key for key in _SUBJECTS if key in given]
    if len(subjects) != 1:
        yield (
            where,
            f"needs one of {', '.join(_SUBJECTS)}, it has {' and '.join(subjects) or 'none'}",
        )
        return
    subject = subjects[0]
    for key in given:
        if key not in ("at", subject, *_SUBJECTS[subject]):
            yield (*where, key), f"has no meaning beside {subject!r}"
    if subject == "body" and action.position is None:
        yield where, "'position' is missing"
    try:
        _ = action.at_ns
    except WiringError as exc:
        yield (*where, "at"), str(exc)
