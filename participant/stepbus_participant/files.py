"""Files that are read: found by the names of a scenario, and never a pipe or a device; logs."""

import errno
import importlib.util
import os
import stat
from pathlib import Path

from stepbus_schemas import WiringError

from .packages import extra_hint, import_error_hint

_QUOTED_LINES = 3
_QUOTED = 300
_TAIL_BYTES = 4096


def find_file(name: str, folder: Path) -> Path:
    """Return the file of a name: relative to a folder, absolute, or `package://<package>/<path>`.

    Raises WiringError when there is no such file, or no such package (see `package_path`).
    """
    path = package_path(name, folder) if name.startswith("package://") else folder / name
    if not _exists(path):
        raise WiringError(f"file {name!r} not found ({path})")
    return path


def package_path(url: str, folder: Path | None = None) -> Path:
    """Return the file behind `package://<package>/<path>`.

    The package is an installed Python package, a folder of `cmeel.prefix/share`, or else a folder
    of that name that has the file, in `folder` or above it.
    Raises WiringError when there is no such package, or when the path leads out of it.
    """
    package, _, rest = url.removeprefix("package://").lstrip("/").partition("/")
    if rest.startswith("/") or ".." in rest.split("/"):
        raise WiringError(f"{url} points outside its package; name a file inside it, without `..`")
    return package_folder(package, folder, rest) / rest


def package_folder(package: str, folder: Path | None, rest: str = "") -> Path:
    """Return the folder of a package, as `$(find <package>)` names it; see `package_path`.

    rest: path of a file that a folder which is not installed has to have. Raises WiringError when
    there is no such package.
    """
    if (installed := _installed(package)) is not None:
        return installed
    above = () if folder is None else (folder, *folder.absolute().parents)
    for parent in above:
        for place in (parent / package, parent):
            if place.name == package and _exists(place / rest):
                return place
    where = f", and no folder {package!r} is in or above {folder}" if above else ""
    where += f" and has {rest}" if above and rest else ""
    raise WiringError(f"package {package!r} is not installed{extra_hint(package) or where}")


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:
        # A name that is too long, for example.
        return False


def _installed(package: str) -> Path | None:
    """Return the folder of an installed Python package, or of `cmeel.prefix/share`."""
    spec = importlib.util.find_spec(package) if package.isidentifier() else None
    if spec is not None and spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations)))
    cmeel = importlib.util.find_spec("cmeel")
    if cmeel is None or cmeel.origin is None:
        return None
    share = Path(cmeel.origin).parent.parent / "cmeel.prefix" / "share" / package
    return share if package and share.is_dir() else None


_MOST_BYTES = 1024**3
"""Of a file: models and meshes have megabytes."""
_MOST_TEXT_BYTES = 64 * 1024**2
"""Of a file that a person or a program has written as text."""


def open_regular(path: str | os.PathLike[str], flags: int = 0) -> int:
    """Return a descriptor to read a regular file, never a pipe or a device.

    flags: further ones, such as os.O_NOFOLLOW. Raises OSError when it is none or cannot be read.
    """
    # Without O_NONBLOCK, opening a named pipe waits for a process that writes to it.
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | flags)
    mode = os.fstat(file).st_mode
    if stat.S_ISREG(mode):
        return file
    os.close(file)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, "is a folder, not a file", str(path))
    raise OSError(errno.EINVAL, "it is not a regular file", str(path))


def read_file(path: Path, most_bytes: int = _MOST_BYTES) -> bytes:
    """Return the content of a regular file; raises OSError when it is none, or larger."""
    with os.fdopen(open_regular(path), "rb") as file:
        size = os.fstat(file.fileno()).st_size
        content = file.read(most_bytes + 1) if size <= most_bytes else b""
    if max(size, len(content)) > most_bytes:
        what = f"it has {size} bytes; the limit is {most_bytes}"
        raise OSError(errno.EFBIG, what, str(path))
    return content


def read_text(path: Path, encoding: str = "utf-8", errors: str = "strict") -> str:
    """Return the text of a regular file, with line feeds as the ends of its lines.

    encoding, errors: as of `bytes.decode`. Raises OSError as `read_file`, UnicodeDecodeError.
    """
    text = read_file(path, _MOST_TEXT_BYTES).decode(encoding, errors)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def last_lines(log: Path) -> str:
    """Return the end of a log for a message: its last lines, as they are; empty where it has none.

    What pip can install of a missing module follows them.
    """
    try:
        with log.open("rb") as file:
            file.seek(max(0, file.seek(0, 2) - _TAIL_BYTES))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    quoted = " | ".join(lines[-_QUOTED_LINES:])[-_QUOTED:]
    return quoted + import_error_hint(quoted)
