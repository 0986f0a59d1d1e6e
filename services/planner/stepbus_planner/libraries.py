"""The libraries that only the planner needs; they come with the extra `robots`."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from stepbus_schemas import WiringError

_EXTRA = "robots"


def need(*modules: str) -> tuple[Any, ...]:
    """Return modules of the extra `robots`, imported.

    Raises WiringError that names those which are not installed.
    """
    found, missing = [], dict[str, None]()
    for name in modules:
        try:
            found.append(import_module(name))
        except ModuleNotFoundError as exc:
            missing[str(exc.name)] = None
    if missing:
        raise WiringError(
            f"the planner needs {' and '.join(missing)}; pip install 'stepbus[{_EXTRA}]'"
        )
    return tuple(found)
