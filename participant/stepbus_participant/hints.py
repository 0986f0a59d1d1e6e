"""What an error message suggests: the nearest name, the extra to install; and imports made late."""

import difflib
import json
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
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
            missing[str(exc.name)] = None
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        raise ExtraMissing(
            f"{who} needs {' and '.join(missing)}, which {verb} not installed"
            f"{extra_hint(next(iter(missing)))}"
        )
    return tuple(imported)


@cache
def installed_version(package: str) -> str:
    """Return the version of an installed package, such as `eclipse-zenoh`.

    As of `importlib.metadata`, which takes 15 ms to load: with three participants, a tenth of a
    start. Raises PackageNotFoundError, a ModuleNotFoundError, where there is none.
    """
    wanted = _normal(package)
    for entry in sys.path:
        for metadata in _metadata(Path(entry), wanted):
            for line in metadata.read_text(encoding="utf-8").splitlines():
                if line.startswith("Version:"):
                    return line.removeprefix("Version:").strip()
    # In a zip file, or an egg of old.
    from importlib.metadata import version  # noqa: PLC0415  see above

    return version(package)


def _metadata(folder: Path, wanted: str) -> list[Path]:
    """Return the METADATA of a package in a folder of packages, if it has it."""
    try:
        folders = [item.name for item in folder.iterdir() if item.name.endswith(".dist-info")]
    except OSError:
        return []
    names = [name for name in folders if _normal(name.partition("-")[0]) == wanted]
    paths = [folder / name / "METADATA" for name in names]
    return [path for path in paths if path.is_file()]


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


_MOST_COMPARED, _MOST_SHOWN, _LONGEST = 1000, 40, 100


def suggest(name: object, known: Iterable[object]) -> str:
    """Return `; did you mean 'x'?`, or the known names where none is near."""
    names = list(dict.fromkeys(str(item) for item in known))
    # To compare takes time with the length of each, and with their number.
    short = [one for one in names[:_MOST_COMPARED] if len(one) <= _LONGEST]
    near = difflib.get_close_matches(str(name)[:_LONGEST], short, n=1)
    if near:
        return f"; did you mean {near[0]!r}?"
    shown = ", ".join(names[:_MOST_SHOWN])
    more = f" … ({len(names)} in all)" if len(names) > _MOST_SHOWN else ""
    return f"; known: {shown}{more}" if names else ""


def imported_later(package: str, modules: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a package; modules: name → module below the package."""

    def import_name(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f".{modules[name]}", package), name)

    return import_name
