"""The emergency stop of a plant: a state that is set, released, and published."""

from collections.abc import Callable

from stepbus_plant.commander import Commander
from stepbus_schemas import Description, EmergencyStop


class StopSwitch:
    """Brakes what the drivers move from one change to the next, whatever is commanded meanwhile.

    drivers: of the inputs; those of grippers do not obey, and keep what they hold. state: what is
    published at the first step and after every change.
    """

    description = Description()

    def __init__(self) -> None:
        self.drivers: list[Commander] = []
        self.state = EmergencyStop(active=False)
        self.is_told = False

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
        self.is_told = False
        for driver in self.drivers:
            if active and driver.obeys_stop:
                driver.halt()
        record(t_ns, f"emergency stop{'' if active else ' released'} by {by}")

    def sense(self, _t_ns: int) -> EmergencyStop | None:
        """Return the state, if it has changed."""
        if self.is_told:
            return None
        self.is_told = True
        return self.state
