"""report.html: a run, or several beside each other, on one page that opens offline."""

from .report_page import PAGE_FILE, page_line, report, write_page

__all__ = ["PAGE_FILE", "page_line", "report", "write_page"]
