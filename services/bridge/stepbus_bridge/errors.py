"""Errors of the bridge.

OutputError (of stepbus)
└─ BridgeError      the bridged program ended, or wrote something that is no answer
"""

from __future__ import annotations

from stepbus_participant import OutputError


class BridgeError(OutputError):
    """The bridged program ended, or wrote something that is no answer; the text names it."""
