"""Plots a recording."""

from .run_report import write_report

__all__ = ["write_report"]
