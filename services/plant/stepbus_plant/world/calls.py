"""Calls that change the world between two steps."""

import math
from collections.abc import Callable, Mapping

from stepbus_participant import CallError, Method, suggest

from .script import Script


class WorldCalls:
    """Answers calls about the bodies of a world. time_ns: returns its time [ns]."""

    def __init__(self, script: Script, time_ns: Callable[[], int]) -> None:
        self._script = script
        self._time_ns = time_ns

    def methods(self) -> Mapping[str, Method]:
        """Return every call by its name."""
        return {
            "body_names": Method(self.names, "names of all bodies"),
            "move_body": Method(
                self.move,
                "NAME X Y Z [YAW]: puts a body, which is then at rest, at a position [m] and "
                "heading [rad]",
                changes=True,
            ),
        }

    def names(self) -> list[str]:
        """Return the names of all bodies, in the order of the world."""
        return self._script.body_names

    def move(self, name: str, x: float, y: float, z: float, yaw: float | None = None) -> None:
        """Put a body somewhere; raises CallError for an unknown body, or what is no number."""
        known = self._script.body_names
        if not isinstance(name, str) or name not in known:
            raise CallError(f"body {name!r} is unknown{suggest(str(name), known)}")
        for value in (x, y, z, *([] if yaw is None else [yaw])):
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not is_number or not math.isfinite(value):
                raise CallError(f"body {name}: {value!r} is no number")
        rpy = None if yaw is None else (0.0, 0.0, float(yaw))
        self._script.move(self._time_ns(), name, (float(x), float(y), float(z)), rpy)
