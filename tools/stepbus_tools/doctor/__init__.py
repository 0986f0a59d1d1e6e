"""Checks this machine for what stepbus needs."""

from .bus import link
from .finding import Finding
from .machine import cores, disk, ports, socket_path
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
