"""FMUs (Functional Mock-up Interface 2.0 and 3.0, co-simulation) take part in runs.

Everything is imported when it is first used: the help of the commands loads this package.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .params import Params
    from .participant import Fmu

__all__ = ["Fmu", "Params"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(".participant" if name == "Fmu" else ".params", __name__)
    return getattr(module, name)
