"""The command line: a thin layer over the library, and the only code that prints or exits.

What commands of other packages use (entry points `stepbus.commands`) is imported when it is first
used: the command `stepbus` takes signals before.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .entry import main

if TYPE_CHECKING:
    from stepbus_orchestrator.cli.live import displayed
    from stepbus_orchestrator.cli.output import Answer, print_error, say, visible

    from .parameters import (
        Command,
        FoxglovePort,
        Json,
        PortNumber,
        RecordingPath,
        ScenarioName,
        Set,
        command,
        number,
    )
    from .signals import interruptible, settle

__all__ = [
    "Answer",
    "Command",
    "FoxglovePort",
    "Json",
    "PortNumber",
    "RecordingPath",
    "ScenarioName",
    "Set",
    "command",
    "displayed",
    "interruptible",
    "main",
    "number",
    "print_error",
    "say",
    "settle",
    "visible",
]


def __getattr__(name: str) -> Any:
    """Import a name when it is first used (PEP 562), from the module that has it."""
    if name in __all__:
        for home in ("output", "signals", "live", "parameters"):
            module = import_module(f"{__name__}.{home}")
            if hasattr(module, name):
                return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
