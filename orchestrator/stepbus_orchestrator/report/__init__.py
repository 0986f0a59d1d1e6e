"""Plots a recording."""

from .report import REPORT_FILE, write_report

__all__ = ["REPORT_FILE", "write_report"]
