"""Exports of a recording: tables, films, and files of other programs."""

from .columns import CLOCK, Column, Table
from .every import FORMS, damage_line, export
from .files import Exported, replaced, unreadable
from .progress import progress_bar

__all__ = [
    "CLOCK",
    "FORMS",
    "Column",
    "Exported",
    "Table",
    "damage_line",
    "export",
    "progress_bar",
    "replaced",
    "unreadable",
]
