"""What installed packages add: participants and scenarios; and which of them are missing."""

import importlib.util
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from stepbus_orchestrator.plugins import points
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import PARTICIPANTS, ExtraMissing, extra_hint

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
    lacking = ((spec.name, missing(spec)) for spec in scenario.participants if not spec.is_external)
    lines = [f"participants.{name}: {text}" for name, text in lacking if text]
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


def declared(group: str) -> tuple[str, ...]:
    """Return the modules of an entry point group, such as `stepbus.participants`, sorted."""
    return tuple(sorted({point.value for point in points(group)}))


def participant_classes() -> tuple[str, ...]:
    """Return the participants that packages declare, as `participant` of a scenario names them."""
    return declared(PARTICIPANTS)


def scenario_folders() -> dict[str, Path]:
    """Return package → folder of the scenarios that installed packages declare."""
    folders = {name: _folder(name) for name in declared("stepbus.scenarios")}
    return {name: folder for name, folder in folders.items() if folder is not None}


def _folder(package: str) -> Path | None:
    """Return the folder of a package; imports nothing."""
    top, *below = package.split(".")
    spec = find_spec(top)
    if spec is None or not spec.submodule_search_locations:
        return None
    folder = Path(next(iter(spec.submodule_search_locations)), *below).resolve()
    return folder if folder.is_dir() else None
