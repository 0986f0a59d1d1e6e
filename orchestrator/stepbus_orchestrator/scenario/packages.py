"""What installed packages add to stepbus, its own included: participants and scenarios."""

from importlib.util import find_spec
from pathlib import Path

from stepbus_orchestrator.plugins import points
from stepbus_participant import PARTICIPANTS


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
