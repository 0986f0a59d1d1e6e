"""Scripts for CoppeliaSim's remote API, new and old, take part in runs as they are.

Everything is imported when it is first used: the help of the command loads this package.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .gateway import Gateway
    from .params import Params

__all__ = ["Gateway", "Params"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{name.lower()}", __name__), name)
