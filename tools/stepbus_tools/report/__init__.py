"""What is drawn of a recording as curves, and said of it in lines."""

from .picture import draw_report, write_report

__all__ = ["draw_report", "write_report"]
