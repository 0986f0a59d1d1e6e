"""Exports of a recording: tables, films, and files of other programs."""

from .exporter import Exported as Exported
from .exporter import check_readable as check_readable
from .exporter import damage_line as damage_line
from .exporter import export as export
from .exporter import progress_bar as progress_bar
