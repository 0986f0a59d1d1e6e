"""What brakes a plant without a command: the emergency stop, and a watchdog of its inputs."""

from collections.abc import Callable

from stepbus_participant import format_duration
from stepbus_plant.commander import Commander
from stepbus_plant.memory import Remembers
from stepbus_schemas import Description, EmergencyStop


class StopSwitch(Remembers):
    """Brakes what the drivers move from one change to the next, whatever is commanded meanwhile.

    drivers: by input; those of grippers do not obey, and keep what they hold. state: of now.
    """

    remembers, parts = ("state",), ("drivers",)
    state: EmergencyStop
    description = Description()

    def __init__(self) -> None:
        self.drivers: dict[str, Commander] = {}
        self.state = EmergencyStop(active=False)

    def set(self, t_ns: int, by: str, record: Callable[[int, str], None], *, active: bool) -> None:
        """Stop, or let commands move again; what is so already stays as it is.

        t_ns: now [ns]. by: who asks. record: takes the time and what has happened.
        """
        if active == self.state.active:
            return
        self.state = EmergencyStop(active=active, by=by, since=t_ns * 1e-9)
        for driver in self.drivers.values():
            if active and driver.obeys_stop:
                driver.halt()
        record(t_ns, f"emergency stop{'' if active else ' released'} by {by}")

    def sense(self, _t_ns: int) -> EmergencyStop:
        """Return the state."""
        return self.state

    def watch(self, t_ns: int, longest_ns: int, record: Callable[[int, str], None]) -> None:
        """Halt what has had no command for some time, until the next one; record: as of `set`.

        longest_ns: how long that is [ns]. A driver that has had no command yet is left alone.
        """
        for port, driver in self.drivers.items():
            heard_ns = driver.state.heard_ns
            if driver.obeys_stop and heard_ns is not None and t_ns - heard_ns >= longest_ns:
                driver.state.heard_ns = None
                driver.halt()
                longest = format_duration(longest_ns)
                record(t_ns, f"no command on input {port!r} for {longest}: it brakes")
