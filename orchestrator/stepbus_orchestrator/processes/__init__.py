"""The processes of a run: started, watched, ended."""

from .child import Child
from .credentials import ORCHESTRATOR, certificates, passwords
from .delays import Delays
from .endpoints import (
    Mesh,
    low_latency,
    make_mesh,
    new_token,
    private_folder,
)
from .launcher import Launcher
from .watchdog import Watchdog

__all__ = [
    "ORCHESTRATOR",
    "Child",
    "Delays",
    "Launcher",
    "Mesh",
    "Watchdog",
    "certificates",
    "low_latency",
    "make_mesh",
    "new_token",
    "passwords",
    "private_folder",
]
