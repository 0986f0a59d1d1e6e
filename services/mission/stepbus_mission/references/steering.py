"""What calls change of a mission that publishes references, from the next step on."""

import math
from collections.abc import Callable, Iterable, Sequence

import msgspec

from stepbus_participant import CallError, suggest
from stepbus_schemas import JointReference

from .polynomials import Knot, evaluate, quintic


def _radians(position: float | str) -> float:
    """Return an angle [rad]; text: degrees."""
    text = position.removesuffix("deg").removesuffix("°") if isinstance(position, str) else ""
    try:
        return math.radians(float(text)) if isinstance(position, str) else position
    except ValueError as exc:
        raise CallError(f"{position!r} is no target: write rad, or degrees such as 30deg") from exc


class SavedTargets(msgspec.Struct):
    """paths: of joints by index, as in `Targets`. last: the newest reference and its time [s]."""

    paths: dict[int, tuple[float, float, Knot, float]]
    last: tuple[float, list[float], list[float], list[float]] | None


class Targets:
    """Positions that joints were sent to, instead of following the task.

    joints: of the reference, in its order.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = list(joints)
        self._pending: list[Callable[[float], None]] = []
        self._paths: dict[int, tuple[float, float, Knot, float]] = {}
        self._last: tuple[float, JointReference] | None = None

    def set_target(self, joint: str, position: float | str, duration_s: float = 0.0) -> None:
        """Send a joint to a position [rad], with minimum jerk over a time [s]; 0: at once.

        position: a number, or degrees such as `30deg`. Raises CallError for an unknown joint, or
        what is no number.
        """
        index = self._index(joint)
        position = _radians(position)
        numbers = (position, duration_s)
        is_number = [isinstance(n, int | float) and not isinstance(n, bool) for n in numbers]
        if not all(is_number) or not all(map(math.isfinite, numbers)) or duration_s < 0:
            raise CallError(f"{joint}: {position!r} rad in {duration_s!r} s is no target")
        target = float(position)
        self._pending.append(lambda t: self._start(index, target, duration_s, t))

    def follow_task(self, joint: str | None = None) -> None:
        """Let a joint follow the task again, or all of them."""
        indices = range(len(self._joints)) if joint is None else [self._index(joint)]
        self._pending.append(lambda _t: self._forget(indices))

    def _forget(self, indices: Iterable[int]) -> None:
        for index in indices:
            self._paths.pop(index, None)

    def _index(self, joint: str) -> int:
        if joint not in self._joints:
            raise CallError(f"joint {joint!r} is unknown{suggest(str(joint), self._joints)}")
        return self._joints.index(joint)

    def _start(self, index: int, position: float, duration_s: float, t: float) -> None:
        if self._last is None or not duration_s:
            self._paths[index] = (t, 0.0, (0.0, 0.0, 0.0), position)
            return
        since, last = self._last
        start = (last.position[index], last.velocity[index], last.acceleration[index])
        self._paths[index] = (since, duration_s, start, position)

    def save(self) -> SavedTargets | None:
        """Return where joints were sent, for a checkpoint; None while a call waits for its step."""
        if self._pending:
            return None
        last = None
        if self._last is not None:
            t, found = self._last
            last = (t, list(found.position), list(found.velocity), list(found.acceleration))
        return SavedTargets(paths=dict(self._paths), last=last)

    def restore(self, saved: SavedTargets) -> None:
        """Take what `save` returned."""
        self._paths = dict(saved.paths)
        if saved.last is not None:
            t, position, velocity, acceleration = saved.last
            reference = JointReference(
                position=position, velocity=velocity, acceleration=acceleration
            )
            self._last = t, reference

    def apply(self, t: float, task: JointReference) -> JointReference:
        """Return the reference of a time [s]; task: that of the task."""
        for change in self._pending:
            change(t)
        self._pending.clear()
        found = task if not self._paths else self._moved(t, task)
        self._last = t, found
        return found

    def _moved(self, t: float, task: JointReference) -> JointReference:
        rows = (list(task.position), list(task.velocity), list(task.acceleration))
        for index, (since, duration_s, start, position) in self._paths.items():
            end = (position, 0.0, 0.0)
            knot = end
            if t - since < duration_s:
                knot = evaluate(quintic(start, end, duration_s), t - since)
            for row, value in zip(rows, knot, strict=True):
                row[index] = value
        return JointReference(position=rows[0], velocity=rows[1], acceleration=rows[2])
