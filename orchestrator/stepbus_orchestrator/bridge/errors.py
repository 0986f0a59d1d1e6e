"""What the bridge raises.

OutputError (of stepbus)
└─ BridgeError      the program behind the bridge did what it must not
"""

from __future__ import annotations

from stepbus_participant import OutputError


class BridgeError(OutputError):
    """The program behind the bridge ended, or wrote what is no answer; the text names it."""
