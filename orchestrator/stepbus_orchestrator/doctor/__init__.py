"""Looks whether this machine has what stepbus needs."""

from .bus import link
from .finding import Finding
from .machine import cores, disk, ports, socket_path
from .packages import extras, loads, versions

__all__ = ["Finding", "examine"]


def examine() -> list[Finding]:
    """Return what was found, in the order in which it should be read."""
    return [
        *versions(),
        *loads(),
        cores(),
        *disk(),
        socket_path(),
        ports(),
        link("unix"),
        link("tcp"),
        *extras(),
    ]
