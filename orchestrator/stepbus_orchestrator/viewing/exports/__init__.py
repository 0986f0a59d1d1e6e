"""Exports of a recording: Parquet and CSV."""

from .columns import CLOCK, Column, Table
from .files import Exported, replaced, unreadable
from .progress import progress_bar
from .tables import export_tables

__all__ = [
    "CLOCK",
    "Column",
    "Exported",
    "Table",
    "export_tables",
    "progress_bar",
    "replaced",
    "unreadable",
]
