"""Packages of Python: imported when they are first used, their versions, how to install them."""

import os
import re
import sys
from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from stepbus_schemas import WiringError

EXTRAS = {
    "run": (
        "cyclopts",
        "greenlet",
        "isal",
        "mcap",
        "msgpack",
        "numpy",
        "rich",
        "ruamel",
        "trustme",
        "zstandard",
    ),
    "sim": ("coal", "pinocchio", "pybullet", "ruckig"),
    "mujoco": ("mujoco",),
    "report": ("graphviz-pure", "matplotlib", "uplot", "watchfiles"),
    "export": ("PIL", "av", "pandas", "pyarrow", "rosbags"),
    "sweep": ("optuna", "scipy", "uplot"),
    "cluster": ("ray",),
    "coppelia": ("cbor2", "zmq"),
    "fmi": ("fmpy", "pint", "pythonfmu", "pythonfmu3"),
    "rerun": ("rerun",),
    "view": ("collada", "trimesh", "viser"),
    "gym": ("gymnasium",),
    "robots": (
        *("baxter", "cv2", "eaik", "example-robot-data", "ompl", "stepbus_store", "store"),
        *("toppra", "xacro"),
    ),
}
"""Extra of stepbus → modules and model packages that it installs.

Robots and their scenarios are a separate package.
"""
_MISSING = re.compile(r"No module named '([\w.]+)'")
_LIBRARY = re.compile(r"(lib[\w+-]+)\.so\.?(\d*)[\d.]*: cannot open shared object file: No such")


class ExtraMissing(WiringError, ImportError):
    """A module of an optional extra is not installed."""


def install_command(extra: str) -> str:
    """Return the command that installs an extra of the installed stepbus."""
    # pip keeps an installed stepbus, be it from a clone, a file or an index, and adds the extra.
    return f"pip install 'stepbus[{extra}]'"


def extra_hint(module: str) -> str:
    """Return `; pip install …` for a module, package or scenario of an extra; else nothing."""
    top = re.split("[. ]", module, maxsplit=1)[0]
    extra = next((extra for extra, modules in EXTRAS.items() if top in modules), "")
    if extra == "robots":
        return "; to install, run `make robots`"
    return f"; {install_command(extra)}" if extra else ""


def import_error_hint(text: str) -> str:
    """Return the hint for the text of an ImportError, `No module named 'pybullet'`; or nothing."""
    if library := _LIBRARY.search(text):
        package = f"{library[1].lower()}{library[2]}"  # as Debian names those of libraries
        return f"; the system lacks a library; on Debian and Ubuntu: sudo apt-get install {package}"
    match = _MISSING.search(text)
    return extra_hint(match[1]) if match else ""


def need(who: str, *modules: str) -> tuple[Any, ...]:
    """Return modules of an extra, imported; who: needs them, e.g. `the planner`.

    Raises ExtraMissing that names those that are not installed, and how to install them.
    """
    imported, missing = [], dict[str, None]()
    for name in modules:
        try:
            imported.append(import_module(name))
        except ModuleNotFoundError as exc:
            missing[str(exc.name).partition(".")[0]] = None
    if missing:
        raise ExtraMissing(lacks(who, *missing))
    return tuple(imported)


def lacks(who: str, *modules: str) -> str:
    """Return the error message for modules that are not installed, with the command that helps."""
    verb = "is" if len(modules) == 1 else "are"
    hint = extra_hint(modules[0])
    return f"{who} needs {' and '.join(modules)}, which {verb} not installed{hint}"


def _normal(package: str) -> str:
    return re.sub(r"[-_.]+", "_", package).lower()


@cache
def _installed(place: str) -> Mapping[str, str]:
    """Return name → version of the packages in a folder."""
    folder, found = Path(place), dict[str, str]()
    for name in os.listdir(folder) if folder.is_dir() else ():  # noqa: PTH208  (five times as quick)
        package, _, version = name.removesuffix(".dist-info").partition("-")
        if name.endswith(".dist-info") and (folder / name / "METADATA").is_file():
            found.setdefault(_normal(package), version)
    return found


@cache
def installed_version(package: str) -> str:
    """Return the version of an installed package, such as `eclipse-zenoh`.

    As of `importlib.metadata`, which takes 15 ms to load: with three participants, a tenth of a
    start. Raises PackageNotFoundError, a ModuleNotFoundError, where there is none.
    """
    name = _normal(package)
    for place in sys.path:
        if name in _installed(place):
            return _installed(place)[name]
    # In a zip file, or an egg of old.
    from importlib.metadata import version  # noqa: PLC0415  see above

    return version(package)


def imported_later(package: str, modules: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a package; modules: name → module below the package."""

    def import_name(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f".{modules[name]}", package), name)

    return import_name
