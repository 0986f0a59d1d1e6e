"""Exports of a recording: Parquet and CSV."""

from .files import Exported
from .progress import progress_bar
from .tables import export_tables

__all__ = ["Exported", "export_tables", "progress_bar"]
