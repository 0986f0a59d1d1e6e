"""Exports of a recording: tables, films, and files of other programs."""

from stepbus_tools.viewing.exports.export_files import (
    Exported,
    check_readable,
    progress_bar,
    unreadable,
)

from .columns import CLOCK, Column, Table
from .every import FORMS, damage_line, export

__all__ = [
    "CLOCK",
    "FORMS",
    "Column",
    "Exported",
    "Table",
    "check_readable",
    "damage_line",
    "export",
    "progress_bar",
    "unreadable",
]
