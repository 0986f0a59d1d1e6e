"""The command line: a thin layer over the library, and the only code that prints or exits.

What a command of another package uses (entry points `stepbus.commands`) is imported when it is
first used: the command `stepbus` takes signals before.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .entry import main

if TYPE_CHECKING:
    from stepbus_orchestrator.cli.live import displayed
    from stepbus_orchestrator.cli.output import print_error, say, say_json, visible

    from .command import (
        Command,
        add_foxglove,
        add_overrides,
        add_recording,
        add_scenario_arguments,
        number,
        port,
        seconds,
    )
    from .signals import interruptible, settle

_HOMES = {
    "Command": "command",
    "add_foxglove": "command",
    "add_overrides": "command",
    "add_recording": "command",
    "add_scenario_arguments": "command",
    "displayed": "live",
    "interruptible": "signals",
    "number": "command",
    "port": "command",
    "print_error": "output",
    "say": "output",
    "say_json": "output",
    "seconds": "command",
    "settle": "signals",
    "visible": "output",
}
"""Name → its module."""

__all__ = [
    "Command",
    "add_foxglove",
    "add_overrides",
    "add_recording",
    "add_scenario_arguments",
    "displayed",
    "interruptible",
    "main",
    "number",
    "port",
    "print_error",
    "say",
    "say_json",
    "seconds",
    "settle",
    "visible",
]


def __getattr__(name: str) -> Any:
    """Import a name when it is first used (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
