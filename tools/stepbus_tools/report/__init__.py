"""What is drawn of a recording as curves, and said of it in lines."""

from .picture import REPORT_FILE, draw_report, write_report

__all__ = ["REPORT_FILE", "draw_report", "write_report"]
