"""The orchestrator: starts participants, drives them in lockstep, records them.

Users import the same from `stepbus`. Functions whose name is also that of a sub-package have a
longer one here. All is loaded when it is first used: the command `stepbus` takes signals before.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .exports import *  # noqa: F403  (its `__all__`)


def __getattr__(name: str) -> Any:
    if name.startswith("_") and name != "__all__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.exports"), name)
