"""Whether the packages of extras are here that participants of ours cannot start without."""

import importlib.util
from collections.abc import Iterator

from stepbus_participant import ExtraMissing, extra_hint

from .model import ParticipantSpec, Scenario

NEEDS = {
    "stepbus_controller": ("pinocchio",),
    "stepbus_gym": ("gymnasium",),
    "stepbus_mission.round_trip": ("pinocchio",),
    "stepbus_plant": ("pybullet",),
}
"""Package of a participant, or a module in it → what it imports at its start."""


def missing(spec: ParticipantSpec) -> str:
    """Return which packages a participant lacks here, and how to install them; empty: none."""
    module = spec.participant.rpartition(":")[0]
    lacking = [name for name in _needs(module) if module and not _is_here(name)]
    if not lacking:
        return ""
    verb = "is" if len(lacking) == 1 else "are"
    names = " and ".join(lacking)
    return f"{module} needs {names}, which {verb} not installed{extra_hint(lacking[0])}"


def check_installed(scenario: Scenario) -> None:
    """Raise ExtraMissing where participants cannot start for want of a package."""
    found = ((spec.name, missing(spec)) for spec in scenario.participants if not spec.is_external)
    lines = [f"participants.{name}: {text}" for name, text in found if text]
    if lines:
        raise ExtraMissing("\n".join(lines))


def _needs(module: str) -> Iterator[str]:
    for name, modules in NEEDS.items():
        if f"{module}.".startswith(f"{name}."):
            yield from modules


def _is_here(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False
