"""What a sweep leaves: rows as they come, tables, a page."""

from .journal import Journal
from .sweep_page import PAGE_FILE, extremes, write_page
from .table import TABLE_FILE, TIMES_FILE, write_table

__all__ = [
    "PAGE_FILE",
    "TABLE_FILE",
    "TIMES_FILE",
    "Journal",
    "extremes",
    "write_page",
    "write_table",
]
