"""FMUs (Functional Mock-up Interface 2.0 and 3.0, co-simulation) take part in runs."""

from importlib import import_module
from typing import Any

_MODULES = {"Fmu": ".participant", "Params": ".params"}


def __getattr__(name: str) -> Any:
    # Nothing is imported before it is used: the help of the commands loads this package.
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name], __name__), name)
