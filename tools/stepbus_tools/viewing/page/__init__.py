"""report.html: a run, or several beside each other, on one page that opens offline."""

from .content import RunPage
from .report_page import PAGE_FILE, render_page, write_page

__all__ = ["PAGE_FILE", "RunPage", "render_page", "write_page"]
