"""Files that participants read: by the names of a scenario, models of robots, logs.

What reads models is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .last_error import last_error
from .paths import find_file, package_path
from .reading import open_regular, read_file, read_text
from .writing import (
    append_to,
    irregular,
    is_shared,
    make_file,
    make_folder,
    make_new_folder,
    write_file,
)

if TYPE_CHECKING:
    from .urdf import read_urdf_text, urdf_warnings
    from .urdf_check import Mimic, mimics, parse_urdf

_WHERE = {
    "Mimic": "urdf_check",
    "mimics": "urdf_check",
    "parse_urdf": "urdf_check",
    "read_urdf_text": "urdf",
    "urdf_warnings": "urdf",
}

__all__ = [
    "Mimic",
    "append_to",
    "find_file",
    "irregular",
    "is_shared",
    "last_error",
    "make_file",
    "make_folder",
    "make_new_folder",
    "mimics",
    "open_regular",
    "package_path",
    "parse_urdf",
    "read_file",
    "read_text",
    "read_urdf_text",
    "urdf_warnings",
    "write_file",
]


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(import_module(f".{_WHERE[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
