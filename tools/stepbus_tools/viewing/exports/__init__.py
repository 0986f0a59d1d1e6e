"""Exports of a recording: tables, films, and files of other programs."""

from .columns import CLOCK, Column, Table
from .every import FORMS, damage_line, export
from .files import Exported, check_readable, unreadable
from .progress import progress_bar

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
