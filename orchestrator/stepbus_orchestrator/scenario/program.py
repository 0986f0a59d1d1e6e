"""Which program or class a participant starts, and whether it is there."""

import importlib.util
import os
import shutil
import sys
from collections.abc import Sequence
from importlib.machinery import PathFinder
from pathlib import Path

from msgspec import structs

from stepbus_orchestrator.plugins import points
from stepbus_orchestrator.scenario.scenario_files import is_file
from stepbus_participant import PARTICIPANTS, ExtraMissing, extra_hint, is_installed, lacks, suggest
from stepbus_schemas import BridgeFormat, WiringError

from .model import BridgeSpec, ParticipantSpec, Scenario

NEEDS = {
    "stepbus_controller": ("pinocchio",),
    "stepbus_gym": ("gymnasium",),
    "stepbus_plant": ("pybullet or mujoco",),
}
"""Package of a participant, or a module in it → what it imports at its start; any of several."""

PYTHON = (sys.executable, "-P")
"""Python that searches the installed packages only, not the working directory."""


def command(words: Sequence[str], folder: Path) -> tuple[str, ...]:
    """Return the command that starts a participant, with `folder` as its working directory.

    words: `program` of a participant. `python` is this interpreter and `stepbus` this installation;
    any other program is a file of the scenario's folder, or else one on PATH. So is the one behind
    `stepbus bridge … --`.

    Raises WiringError when there is no such program.
    """
    program, rest = words[0], words[1:]
    if program == "python":
        runs_ours = len(rest) > 1 and rest[0] == "-m" and is_installed(rest[1])
        return (*(PYTHON if runs_ours else PYTHON[:1]), *rest)
    if (program, *rest[:1]) == ("stepbus", "bridge"):
        split = rest.index("--") + 1 if "--" in rest else len(rest)
        bridged = command(rest[split:], folder) if rest[split:] else ()
        return (*PYTHON, "-m", "stepbus_bridge", *rest[1:split], *bridged)
    if program == "stepbus":
        return (*PYTHON, "-m", "stepbus_orchestrator.cli", *rest)
    return (_find(program, folder), *rest)


def replaced_program(
    spec: ParticipantSpec, program: Sequence[str], bridge: BridgeFormat | None
) -> ParticipantSpec:
    """Return a participant with another program, or the same one behind another bridge.

    program: its command line; none: that of the participant. bridge: the format of the bridge to
    it; none: that of the participant, or none where the program is another one.
    """
    if not program and bridge is None:
        return spec
    describe = {} if spec.bridge is None else spec.bridge.describe
    through = None if bridge is None else BridgeSpec(format=bridge, describe=describe)
    replaced = tuple(program) or structs.replace(spec, bridge=None).program
    return structs.replace(spec, participant="", exec=replaced, bridge=through)


def _find(program: str, folder: Path) -> str:
    path = folder / program
    if is_file(path):
        if os.access(path, os.X_OK):
            return str(path)
        raise WiringError(f"{program!r} is not executable; try `chmod +x {path}`")
    file = None if "/" in program else shutil.which(program)
    if file is None:
        where = f"in {folder}" if "/" in program else f"on PATH, nor in {folder}"
        raise WiringError(f"no program {program!r} {where}; is it installed, or to be built?")
    return str(Path(file).absolute())


def check_program(spec: ParticipantSpec, folder: Path) -> None:
    """Raise WiringError if a program, script or module is missing; imports nothing."""
    script = module = ""
    if spec.participant:
        name = spec.participant.rpartition(":")[0]
        script, module = (name, "") if name.endswith(".py") else ("", name)
    else:
        command(spec.exec, folder)
        match spec.exec:
            case ("python", "-m", name, *_):
                module = name
            case ("python", name, *_) if name.endswith(".py"):
                script = name
    if script and not is_file(folder / script):
        scripts = [item.name for item in folder.glob("*.py")]
        raise WiringError(f"no file {script!r} in {folder}{suggest(script, sorted(scripts))}")
    if module:
        _find_module(module, folder)


def _find_module(name: str, folder: Path) -> None:
    """Raise WiringError if there is no such module."""
    parts = name.split(".")
    spec = None
    if all(part.isidentifier() for part in parts) and parts[0] != "__main__":
        # `python -m` puts the working directory, the scenario's folder, first; not for ours.
        own = None if is_installed(name) else PathFinder.find_spec(parts[0], [str(folder)])
        spec = own or importlib.util.find_spec(parts[0])
    for depth in range(2, len(parts) + 1):
        below = spec and spec.submodule_search_locations
        spec = PathFinder.find_spec(".".join(parts[:depth]), list(below)) if below else None
    if spec is not None:
        return
    where = f"neither installed for {sys.executable} nor in {folder}"
    if is_installed(name):
        where = f"not installed for {sys.executable}{extra_hint(name)}"
    known = [item.rpartition(":")[0] for item in participant_classes()]
    raise WiringError(f"no Python module {name!r}, {where}{suggest(name, known)}")


def participant_classes() -> list[str]:
    """Return the participants that packages declare, as `participant` of a scenario names them."""
    return sorted({point.value for point in points(PARTICIPANTS)})


def missing(spec: ParticipantSpec) -> str:
    """Return which packages a participant lacks here, and how to install them; empty: none."""
    module = spec.participant.rpartition(":")[0]
    needs = (needed for key, needed in NEEDS.items() if f"{module}.".startswith(f"{key}."))
    lacking = [
        name
        for names in needs
        for name in names
        if not any(map(importlib.util.find_spec, name.split(" or ")))
    ]
    return lacks(module, *lacking) if lacking else ""


def check_installed(scenario: Scenario) -> None:
    """Raise ExtraMissing where participants cannot start for want of a package."""
    lacking = ((spec.name, missing(spec)) for spec in scenario.participants if spec.is_here)
    lines = [f"participants.{name}: {text}" for name, text in lacking if text]
    if lines:
        raise ExtraMissing("\n".join(lines))
