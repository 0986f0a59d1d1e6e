"""Parameters declared once, the problems of a configuration, and YAML with lines.

The types of parameters are names of `stepbus_participant` itself. What reads YAML is imported when
it is first used: a participant does not need it.
"""

from typing import TYPE_CHECKING

from stepbus_participant.packages import imported_later

from .kinds import Pause as Pause
from .problems import *
from .read import *
from .types_file import *

if TYPE_CHECKING:
    from .yaml_file import *

_LATER = dict.fromkeys(("YamlFile", "fatal", "parse_yaml", "read_yaml", "remember"), "yaml_file")

__getattr__ = imported_later(__name__, _LATER)
