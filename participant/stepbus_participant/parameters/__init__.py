"""Parameters declared once: what is wrong with a configuration, and YAML with lines.

The types of parameters are names of `stepbus_participant` itself. What reads YAML is imported when
it is first used: a participant does not need it.
"""

from typing import TYPE_CHECKING, Any

from .fields import conditions, default, is_own, listed, mark, options_of, plain
from .problems import Keys, Place, Problem, dotted, show
from .read import find_problems, read, read_value
from .settings import Pause
from .types_file import declarations_in, is_file_name, module_types, read_types_file

if TYPE_CHECKING:
    from .yaml_file import YamlFile, fatal, parse_yaml, read_yaml, texts_in

__all__ = [
    "Keys",
    "Pause",
    "Place",
    "Problem",
    "YamlFile",
    "conditions",
    "declarations_in",
    "default",
    "dotted",
    "fatal",
    "find_problems",
    "is_file_name",
    "is_own",
    "listed",
    "mark",
    "module_types",
    "options_of",
    "parse_yaml",
    "plain",
    "read",
    "read_types_file",
    "read_value",
    "read_yaml",
    "show",
    "texts_in",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import yaml_file  # noqa: PLC0415  see above

    return getattr(yaml_file, name)
