"""Checks this machine for what stepbus needs."""

from stepbus_tools.doctor.machine import Finding, cores, disk, ports, socket_path

from .bus import link
from .packages import extras, loads, versions

__all__ = ["Finding", "examine"]


def examine() -> list[Finding]:
    """Return all findings, the ones that others depend on first."""
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
