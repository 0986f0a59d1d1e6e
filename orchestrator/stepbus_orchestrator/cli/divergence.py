"""Where two recordings part, in words."""

from __future__ import annotations

from pathlib import Path


def divergence(first: Path, second: Path) -> str | None:
    """Return the first difference of two recordings' messages; None where all are equal."""
    from ..diff import diff

    found = diff(first, second)
    return None if found.equal else found.text()
