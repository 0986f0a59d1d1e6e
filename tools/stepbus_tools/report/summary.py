"""What the summary of a run says of its joints."""

from collections.abc import Iterator, Mapping

from stepbus_orchestrator.toolkit import Tracking, TrackingError

_SETTLED_S = 2.0
# More joints than that are named by the worst one only.
_MOST_NAMED = 6


class Summary:
    """How well the joints follow their reference; give it all pieces of a recording."""

    def __init__(self) -> None:
        self._last_s = 0.0
        self._units: dict[str, str] = {}
        self._whole, self._settled = TrackingError(0.0), TrackingError(_SETTLED_S)

    def take(self, piece: Tracking) -> None:
        """Take the next piece of a recording."""
        ends = [float(state.t[-1]) for state in piece.states.values()]
        self._last_s = max([self._last_s, *ends])
        self._units |= {joint: piece.unit(joint) for joint in piece.joints}
        for part in (self._whole, self._settled):
            part.take(piece)

    def lines(self) -> list[str]:
        """Return it in lines, none without a reference."""
        settled = self._last_s > _SETTLED_S
        rmse = (self._settled if settled else self._whole).rmse()
        if not rmse:
            return []
        when = f"after {_SETTLED_S:g} s" if settled else "of the whole run"
        if len(rmse) > _MOST_NAMED:
            return [f"tracking RMSE {when}: at most {', '.join(self._worst(rmse))}"]
        units = self._units
        values = ", ".join(f"{joint} {value:.3g} {units[joint]}" for joint, value in rmse.items())
        return [f"tracking RMSE {when}: {values}"]

    def _worst(self, rmse: Mapping[str, float]) -> Iterator[str]:
        """Yield the worst joint of each unit."""
        for unit in ("rad", "m"):
            joints = [joint for joint in rmse if self._units[joint] == unit]
            if joints:
                worst = max(joints, key=lambda joint: rmse[joint])
                yield f"{rmse[worst]:.3g} {unit} ({worst})"
