"""What a program last said in its log, when it has ended."""

from __future__ import annotations

import re
from pathlib import Path

from stepbus_participant import import_error_hint

_TAIL_BYTES = 4000
_LONGEST = 300
_COMPLAINT = re.compile(r"error|exception|panic", re.IGNORECASE)
_GREETING = "pybullet build time:"
"""What PyBullet prints when it is loaded; nobody's last words."""


def last_error(log: Path) -> str:
    """Return the last complaint in a log, or else its last line; nothing where there is none."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, file.seek(0, 2) - _TAIL_BYTES))
            lines = file.read().decode(errors="replace").split("\n")
    except OSError:
        return ""
    said = [line.strip() for line in lines]
    said = [line for line in said if line and not line.startswith(_GREETING)]
    complaints = [line for line in said if _COMPLAINT.search(line)]
    last = (complaints or said or [""])[-1][:_LONGEST]
    return last + import_error_hint(last)
