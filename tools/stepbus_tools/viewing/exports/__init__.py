"""Exports of a recording: tables, films, and files of other programs."""

from .exporter import (
    Exported,
    Exporter,
    check_readable,
    damage_line,
    export,
    exporters,
    progress_bar,
)

__all__ = [
    "Exported",
    "Exporter",
    "check_readable",
    "damage_line",
    "export",
    "exporters",
    "progress_bar",
]
