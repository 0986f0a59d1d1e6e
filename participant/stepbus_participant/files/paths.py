"""Files by the names that a scenario gives them."""

import importlib.util
from pathlib import Path

from stepbus_participant.hints.extras import extra_hint
from stepbus_schemas import WiringError


def find_file(name: str, folder: Path) -> Path:
    """Return the file of a name: relative to a folder, absolute, or `package://<package>/<path>`.

    Raises WiringError when there is no such file, or no such package (see `package_path`).
    """
    path = package_path(name, folder) if name.startswith("package://") else folder / name
    try:
        exists = path.exists()
    except OSError:
        exists = False
    if not exists:
        raise WiringError(f"no file {name!r} ({path})")
    return path


def package_path(url: str, folder: Path | None = None) -> Path:
    """Return the file behind `package://<package>/<path>`.

    The package is an installed Python package, a folder of `cmeel.prefix/share`, or else a folder
    of that name that has the file, in `folder` or above it.
    Raises WiringError when there is no such package, or when the path leads out of it.
    """
    package, _, rest = url.removeprefix("package://").partition("/")
    if rest.startswith("/") or ".." in rest.split("/"):
        raise WiringError(f"{url} leads out of its package; name a file in it, without `..`")
    spec = importlib.util.find_spec(package) if package.isidentifier() else None
    if spec is not None and spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations))) / rest
    cmeel = importlib.util.find_spec("cmeel")
    if cmeel is not None and cmeel.origin is not None:
        share = Path(cmeel.origin).parent.parent / "cmeel.prefix" / "share"
        if (share / package).is_dir():
            return share / package / rest
    local = None if folder is None else _local(package, rest, folder)
    if local is not None:
        return local
    where = "" if folder is None else f", and no folder {package!r} in {folder} or above has it"
    hint = extra_hint(package)
    raise WiringError(f"{url}: package {package!r} is not installed here{hint or where}")


def _local(package: str, rest: str, folder: Path) -> Path | None:
    for parent in (folder, *folder.absolute().parents):
        try:
            if package and (parent / package / rest).is_file():
                return parent / package / rest
        except OSError:
            continue
    return None
