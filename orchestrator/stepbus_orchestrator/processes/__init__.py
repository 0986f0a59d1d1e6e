"""The processes of a run: started, watched, ended."""

from .activity import Activity, activity
from .bounded_log import BoundedLog
from .child import TERM_GRACE_S, Child
from .delays import Delays
from .launcher import Launcher
from .limits import check_open_files
from .links.credentials import ORCHESTRATOR, certificates, passwords
from .links.endpoints import Mesh, gone, low_latency, make_mesh, new_token, private_folder
from .reaping import Reaper
from .watchdog import Watchdog

__all__ = [
    "ORCHESTRATOR",
    "TERM_GRACE_S",
    "Activity",
    "BoundedLog",
    "Child",
    "Delays",
    "Launcher",
    "Mesh",
    "Reaper",
    "Watchdog",
    "activity",
    "certificates",
    "check_open_files",
    "gone",
    "low_latency",
    "make_mesh",
    "new_token",
    "passwords",
    "private_folder",
]
