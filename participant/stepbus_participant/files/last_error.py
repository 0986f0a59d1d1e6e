"""The last error in the log of a program that has ended."""

from __future__ import annotations

import re
from pathlib import Path

from stepbus_participant.extras import import_error_hint

_TAIL_BYTES = 4000
_LONGEST = 300
_ERROR = re.compile(r"error|exception|panic", re.IGNORECASE)
_BANNER = "pybullet build time:"
"""What PyBullet prints when it is loaded."""


def last_error(log: Path) -> str:
    """Return the last error in a log, or else its last line; empty where there is none."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, file.seek(0, 2) - _TAIL_BYTES))
            lines = file.read().decode(errors="replace").split("\n")
    except OSError:
        return ""
    stripped = (line.strip() for line in lines)
    printed = [line for line in stripped if line and not line.startswith(_BANNER)]
    errors = [line for line in printed if _ERROR.search(line)]
    last = (errors or printed or [""])[-1][:_LONGEST]
    return last + import_error_hint(last)
