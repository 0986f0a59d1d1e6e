"""Optional packages: which extra of stepbus installs a module, and how to install it."""

import json
import re
from importlib import import_module
from typing import Any
from urllib.parse import unquote, urlparse

from stepbus_schemas import WiringError

_EXTRAS = {
    "sim": ("coal", "pinocchio", "pybullet", "ruckig"),
    "report": ("matplotlib", "uplot"),
    "export": ("PIL", "av", "foxglove", "pandas", "pyarrow", "rosbags", "websockets"),
    "sweep": ("optuna", "plotly", "ray", "scipy"),
    "view": ("collada", "trimesh", "viser"),
    "gym": ("gymnasium",),
}
"""Extra of stepbus → the modules and model packages that it installs."""
_ROBOTS = (
    *("baxter", "cv2", "eaik", "example-robot-data", "ompl", "stepbus_store", "store", "toppra"),
    "xacro",
)
"""Scenarios, modules and model packages that come with the robots, a package of its own."""
_MISSING = re.compile(r"No module named '([\w.]+)'")


class ExtraMissing(WiringError, ImportError):
    """A module of an extra is not installed here."""


def install_command(extra: str) -> str:
    """Return the command that installs an extra from where stepbus was installed from.

    That is a clone, a file, an address or an index; a clone where it is not installed at all.
    """
    # It takes longer to load than all else here, and only a hint needs it.
    from importlib.metadata import PackageNotFoundError, distribution  # noqa: PLC0415

    try:
        text = distribution("stepbus").read_text("direct_url.json")
    except PackageNotFoundError:
        return f"pip install '.[{extra}]'"
    source = json.loads(text or "{}")
    address = source.get("url", "")
    url = urlparse(address)
    if url.scheme != "file":
        return f"pip install 'stepbus[{extra}]{f' @ {address}' if address else ''}'"
    edited = "-e " if source.get("dir_info", {}).get("editable", False) else ""
    return f"pip install {edited}'{unquote(url.path)}[{extra}]'"


def extra_hint(module: str) -> str:
    """Return `; pip install …` for a module, package or scenario that we know; else nothing."""
    top = module.partition(".")[0]
    if top in _ROBOTS:
        return "; to install, run `make robots`"
    for extra, modules in _EXTRAS.items():
        if top in modules:
            return f"; {install_command(extra)}"
    return ""


def import_error_hint(text: str) -> str:
    """Return the same for the text of an ImportError, such as `No module named 'pybullet'`."""
    found = _MISSING.search(text)
    return extra_hint(found[1]) if found else ""


def need(who: str, *modules: str) -> tuple[Any, ...]:
    """Return modules of an extra, imported; who: needs them, e.g. `the planner`.

    Raises ExtraMissing that names those that are not installed, and how to install them.
    """
    found, missing = [], dict[str, None]()
    for name in modules:
        try:
            found.append(import_module(name))
        except ModuleNotFoundError as exc:
            missing[str(exc.name)] = None
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        raise ExtraMissing(
            f"{who} needs {' and '.join(missing)}, which {verb} not installed"
            f"{extra_hint(next(iter(missing)))}"
        )
    return tuple(found)
