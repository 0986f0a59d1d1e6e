"""Files that participants read: by the names of a scenario, models of robots, logs."""

from .last_error import last_error
from .paths import find_file, package_path
from .urdf import read_urdf_text, urdf_warnings
from .urdf_check import Mimic, mimics, parse_urdf

__all__ = [
    "Mimic",
    "find_file",
    "last_error",
    "mimics",
    "package_path",
    "parse_urdf",
    "read_urdf_text",
    "urdf_warnings",
]
