"""What brakes a plant without a command: the emergency stop, and a watchdog of its inputs."""

from collections.abc import Callable, Mapping

from stepbus_participant import format_duration
from stepbus_plant.commander import Commander
from stepbus_schemas import Description, EmergencyStop


class StopSwitch:
    """Brakes what the drivers move from one change to the next, whatever is commanded meanwhile.

    drivers: of the inputs; those of grippers do not obey, and keep what they hold. state: of now.
    """

    description = Description()

    def __init__(self) -> None:
        self.drivers: list[Commander] = []
        self.state = EmergencyStop(active=False)

    @property
    def active(self) -> bool:
        """Return whether an emergency stop is in force."""
        return self.state.active

    def set(self, t_ns: int, by: str, record: Callable[[int, str], None], *, active: bool) -> None:
        """Stop, or let commands move again; what is so already stays as it is.

        t_ns: now [ns]. by: who asks. record: takes the time and what has happened.
        """
        if active == self.active:
            return
        self.state = EmergencyStop(active=active, by=by, since=t_ns * 1e-9)
        for driver in self.drivers:
            if active and driver.obeys_stop:
                driver.halt()
        record(t_ns, f"emergency stop{'' if active else ' released'} by {by}")

    def sense(self, _t_ns: int) -> EmergencyStop:
        """Return the state."""
        return self.state


class Watchdog:
    """Brakes what an input drives, once it has brought no command for too long.

    longest_ns: how long that is [ns]; None: each command holds until the next one. heard: input →
    time of its latest command [ns]; an input that has brought none yet is not watched.
    """

    def __init__(self, longest_ns: int | None) -> None:
        self._longest_ns = longest_ns
        self.heard: dict[str, int] = {}

    def hear(self, port: str, t_ns: int) -> None:
        """Take note of a command."""
        if self._longest_ns is not None:
            self.heard[port] = t_ns

    def look(
        self, drivers: Mapping[str, Commander], t_ns: int, record: Callable[[int, str], None]
    ) -> None:
        """Halt what has been left alone; record: takes the time and what has happened."""
        longest_ns = self._longest_ns or 0
        for port in [port for port, at_ns in self.heard.items() if t_ns - at_ns >= longest_ns]:
            # Once; the next command ends it.
            del self.heard[port]
            if drivers[port].obeys_stop:
                drivers[port].halt()
                longest = format_duration(longest_ns)
                record(t_ns, f"no command on input {port!r} for {longest}: it brakes")
