"""Classes that a scenario chooses: built-in ones by a word, a user's own as `module:Class`."""

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stepbus_participant.parameters import read
from stepbus_schemas import WiringError, error_text

from .config import Config


def make_plugin(
    config: Config, key: str, name: str, own: Mapping[str, Any], method: str, *args: Any
) -> Any:
    """Return an instance of a class of the user's own, made from `args` and its parameters.

    key: the parameter that names the class, `module:Class`. own: its parameters: it gets them as
    the settings that its attribute `Params` declares, or else as a map. method: what it has to
    have. Raises SettingsError that lists every problem.
    """
    problems = config.problems().below(("params",))
    found = problems.attempt((key,), lambda: load_class(name, config.folder))
    if found is not None and not callable(getattr(found, method, None)):
        problems.add((key,), f"class {name} has no method {method!r}")
    problems.refuse()
    declared = getattr(found, "Params", None)
    params = own if declared is None else read(declared, own, problems, folder=config.folder)
    problems.refuse()
    made = problems.attempt((key,), lambda: _make(found, *args, params))
    problems.refuse()
    return made


def _make(wanted: Any, *args: Any) -> Any:
    try:
        return wanted(*args)
    except WiringError:
        raise
    except Exception as exc:
        raise WiringError(f"{wanted.__name__} cannot be made: {error_text(exc)}") from exc


def load_class(name: str, folder: Path) -> type[Any]:
    """Return the class that `module:Class` names.

    folder: searched first, before the installed modules. Raises WiringError when there is no such
    module or class in it, or when the module cannot be imported.
    """
    module_name, _, class_name = name.partition(":")
    if not module_name or not class_name.isidentifier():
        raise WiringError(f"{name!r} is not of the form module:Class")
    module = _import(module_name, folder)
    found = getattr(module, class_name, None)
    if not isinstance(found, type):
        raise WiringError(f"module {module_name!r} ({_file(module)}) has no class {class_name!r}")
    return found


def _import(module_name: str, folder: Path) -> Any:
    """Import a module with `folder` searched first, and only for this import."""
    sys.path.insert(0, str(folder))
    try:
        importlib.invalidate_caches()
        return importlib.import_module(module_name)
    except ModuleNotFoundError as exc:
        text = f"no module {exc.name!r} in {folder} or installed"
        raise WiringError(text if exc.name == module_name else f"{module_name}: {text}") from exc
    except Exception as exc:
        raise WiringError(f"module {module_name!r} cannot be imported: {error_text(exc)}") from exc
    finally:
        sys.path.remove(str(folder))


def _file(module: Any) -> str:
    return getattr(module, "__file__", None) or "built in"
