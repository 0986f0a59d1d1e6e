"""The class that a scenario names: `controller.py:Controller` or `my_arm.controller:Controller`."""

import importlib
import inspect
import re
import sys
from pathlib import Path
from types import ModuleType

from stepbus_participant.files import read_file
from stepbus_participant.hints.suggestions import suggest
from stepbus_participant.parameters.settings import Settings
from stepbus_participant.participant import Participant
from stepbus_schemas import WiringError

PARTICIPANTS = "stepbus.participants"
"""The entry points by which packages declare participants, as a scenario names them."""


def is_ours(module: str) -> bool:
    """Return whether a name is a module's of stepbus; no file of a scenario replaces one."""
    top = module.partition(".")[0]
    return top == "stepbus" or top.startswith("stepbus_")


def is_installed(module: str) -> bool:
    """Return whether a module is ours, or of a package that declares participants; likewise."""
    if is_ours(module):
        return True
    # It takes longer to load than all else here, and only some scenarios need it.
    from importlib.metadata import entry_points  # noqa: PLC0415

    top = module.partition(".")[0]
    return any(top == re.split("[.:]", p.value)[0] for p in entry_points(group=PARTICIPANTS))


def import_participant(name: str, folder: Path) -> type[Participant]:
    """Import the class `file.py:Class` or `module:Class`; return it.

    folder: that of the scenario. Raises WiringError where there is no such class, and whatever the
    module raises.
    """
    source, _, attribute = name.rpartition(":")
    module = import_source(source, folder)
    found = getattr(module, attribute, None)
    if found is None:
        raise WiringError(f"no class {attribute!r} in {source}{_alternatives(module, attribute)}")
    if not (isinstance(found, type) and issubclass(found, Participant)):
        raise WiringError(
            f"{attribute!r} in {source} is no participant; write "
            f"`class {attribute}(stepbus.Participant)`{_alternatives(module, attribute)}"
        )
    return found


def import_source(source: str, folder: Path) -> ModuleType:
    """Import a module, or a file of a folder, in which `sys.path` has it search."""
    if not source.endswith(".py"):
        return importlib.import_module(source)
    path = (folder / source).absolute()
    name = _module_name(path)
    if name in sys.modules:
        return sys.modules[name]
    if str(path.parent) not in sys.path:
        # As for `python file.py`: beside it is what it imports.
        sys.path.insert(0, str(path.parent))
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = str(path)
    try:
        # As for `python file.py`, from no cache: that of a file changed in this second is old.
        exec(compile(read_file(path), path, "exec", dont_inherit=True), module.__dict__)  # noqa: S102
    except BaseException:
        sys.modules.pop(name, None)
        raise
    return module


def declared_parameters(source: str, folder: Path) -> type[Settings] | None:
    """Import what a scenario names; return its class `Params`, None where it declares none."""
    found = getattr(import_source(source, folder), "Params", None)
    return found if isinstance(found, type) and issubclass(found, Settings) else None


def _module_name(path: Path) -> str:
    """Return the name of a file's module: its own, unless another module has that."""
    loaded = sys.modules.get(path.stem)
    is_free = loaded is None or getattr(loaded, "__file__", None) == str(path)
    return path.stem if is_free else f"scenario.{path.stem}"


def _alternatives(module: ModuleType, name: str) -> str:
    classes = [
        other
        for other, value in inspect.getmembers(module, inspect.isclass)
        if issubclass(value, Participant) and value is not Participant and other != name
    ]
    return suggest(name, classes) if classes else ""
