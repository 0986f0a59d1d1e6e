"""Parameters declared once: classes, what is wrong with a configuration, and YAML with lines.

What reads YAML is imported when it is first used: a participant does not need it.
"""

from typing import TYPE_CHECKING, Any

from .nodes import conditions, default, is_own, mark, options_of, plain
from .problems import Keys, Place, Problem, Problems, dotted, show, suggest
from .read import find_problems, read, read_value
from .settings import (
    Count,
    Duration,
    File,
    Finite,
    Name,
    Names,
    NonNegative,
    NonNegativePerJoint,
    Own,
    Pause,
    PerJoint,
    PerName,
    Plugin,
    Positive,
    PositivePerJoint,
    Settings,
    SettingsError,
    Share,
    Text,
    Vector3,
    Whole,
    each,
    needed_when,
    when,
)

if TYPE_CHECKING:
    from .yaml_file import YamlFile, fatal, parse_yaml, read_yaml, texts_in

_YAML = ("YamlFile", "fatal", "parse_yaml", "read_yaml", "texts_in")

__all__ = [
    "Count",
    "Duration",
    "File",
    "Finite",
    "Keys",
    "Name",
    "Names",
    "NonNegative",
    "NonNegativePerJoint",
    "Own",
    "Pause",
    "PerJoint",
    "PerName",
    "Place",
    "Plugin",
    "Positive",
    "PositivePerJoint",
    "Problem",
    "Problems",
    "Settings",
    "SettingsError",
    "Share",
    "Text",
    "Vector3",
    "Whole",
    "YamlFile",
    "conditions",
    "default",
    "dotted",
    "each",
    "fatal",
    "find_problems",
    "is_own",
    "mark",
    "needed_when",
    "options_of",
    "parse_yaml",
    "plain",
    "read",
    "read_value",
    "read_yaml",
    "show",
    "suggest",
    "texts_in",
    "when",
]


def __getattr__(name: str) -> Any:
    if name in _YAML:
        from . import yaml_file  # noqa: PLC0415  see above

        return getattr(yaml_file, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
