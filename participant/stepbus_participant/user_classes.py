"""Classes of the user's, imported by the names that a scenario gives them."""

import inspect
import re
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from stepbus_schemas import WiringError, error_text, suggest

from .config import Config
from .files import read_file
from .parameters.read import read
from .parameters.settings import Settings
from .participant import Participant

PARTICIPANTS = "stepbus.participants"
"""The entry points by which packages declare participants, as a scenario names them."""


imported: set[str] = set()
"""Modules and files that this process has imported for a scenario and that are not stepbus's."""


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
    cls = getattr(module, attribute, None)
    if isinstance(cls, type) and issubclass(cls, Participant):
        return cls
    known = [
        other
        for other, value in inspect.getmembers(module, inspect.isclass)
        if issubclass(value, Participant) and value is not Participant
    ]
    why = f"no class {attribute!r} in {source}"
    if cls is not None:
        why = (
            f"{attribute!r} in {source} is not a participant; write "
            f"`class {attribute}(stepbus.Participant)`"
        )
    raise WiringError(why + suggest(attribute, known))


def import_source(source: str, folder: Path) -> ModuleType:
    """Import a module, or a file of a folder, in which `sys.path` has it search."""
    if source.endswith(".py") or not is_ours(source):
        imported.add(source)
    if not source.endswith(".py"):
        return import_module(source)
    path = (folder / source).absolute()
    loaded = sys.modules.get(path.stem)
    is_other = loaded is not None and getattr(loaded, "__file__", None) != str(path)
    name = f"scenario.{path.stem}" if is_other else path.stem
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
    params = getattr(import_source(source, folder), "Params", None)
    return params if isinstance(params, type) and issubclass(params, Settings) else None


def make_plugin(
    config: Config, key: str, name: str, own: Mapping[str, Any], method: str, *args: Any
) -> Any:
    """Return an instance of a class of the user's own, made from `args` and its parameters.

    key: the parameter that names the class, `file.py:Class` or `module:Class`. own: its parameters:
    it gets them as the settings that its attribute `Params` declares, or else as a map. method:
    what it has to have. Raises SettingsError that lists every problem.
    """
    problems = config.problems().below(("params",))
    cls = problems.attempt((key,), lambda: load_class(name, config.folder))
    if cls is not None and not callable(getattr(cls, method, None)):
        problems.add((key,), f"class {name} needs a method {method!r}")
    problems.refuse()
    declared = getattr(cls, "Params", None)
    params = own if declared is None else read(declared, own, problems, folder=config.folder)
    problems.refuse()
    made = problems.attempt((key,), lambda: _make(cls, *args, params))
    problems.refuse()
    return made


def _make(wanted: Any, *args: Any) -> Any:
    try:
        return wanted(*args)
    except WiringError:
        raise
    except Exception as exc:
        raise WiringError(f"cannot create {wanted.__name__}: {error_text(exc)}") from exc


def file_in(name: str) -> str:
    """Return the file of a name such as `my.py:Class`; any other name as it is."""
    source, _, _ = name.rpartition(":")
    return source if source.endswith(".py") else name


def load_class(name: str, folder: Path) -> type[Any]:
    """Return the class that `file.py:Class` or `module:Class` names.

    folder: of the file; searched for the module before the installed ones. Raises WiringError when
    there is no such file, module or class in it, or when it cannot be imported.
    """
    module_name, _, class_name = name.rpartition(":")
    if not module_name or not class_name.isidentifier():
        raise WiringError(f"{name!r} is not of the form file.py:Class or module:Class")
    if module_name.endswith(".py") and not (folder / module_name).is_file():
        raise WiringError(f"no file {module_name!r} in {folder}")
    module = _import(module_name, folder)
    attribute = getattr(module, class_name, None)
    if not isinstance(attribute, type):
        file = getattr(module, "__file__", None) or "built in"
        where = file if module_name.endswith(".py") else f"module {module_name!r} ({file})"
        raise WiringError(f"{where} has no class {class_name!r}")
    return attribute


def _import(module_name: str, folder: Path) -> Any:
    """Import a file, or a module with `folder` searched first, and only for this import."""
    sys.path.insert(0, str(folder))
    try:
        return import_source(module_name, folder)
    except ModuleNotFoundError as exc:
        text = f"module {exc.name!r} is neither in {folder} nor installed"
        raise WiringError(text if exc.name == module_name else f"{module_name}: {text}") from exc
    except Exception as exc:
        kind = "file" if module_name.endswith(".py") else "module"
        raise WiringError(f"cannot import {kind} {module_name!r}: {error_text(exc)}") from exc
    finally:
        sys.path.remove(str(folder))
