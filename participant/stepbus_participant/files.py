"""Files that participants read and write: by the names of a scenario, logs, the last error."""

import contextlib
import errno
import importlib.util
import itertools
import os
import re
import stat
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from stepbus_schemas import WiringError

from .hints import extra_hint, import_error_hint


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


MOST_BYTES = 1024**3
"""Of a file: models and meshes have megabytes."""
MOST_TEXT_BYTES = 64 * 1024**2
"""Of a file that a person or a program has written as text."""


def open_regular(path: str | os.PathLike[str], flags: int = 0) -> int:
    """Return a descriptor to read a regular file, never a pipe or a device.

    flags: further ones, such as os.O_NOFOLLOW. Raises OSError when it is none or cannot be read.
    """
    # Without O_NONBLOCK, to open a named pipe waits for somebody who writes to it.
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | flags)
    mode = os.fstat(file).st_mode
    if stat.S_ISREG(mode):
        return file
    os.close(file)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder", str(path))
    raise OSError(errno.EINVAL, "it is not a regular file", str(path))


def read_file(path: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """Return the content of a regular file; raises OSError when it is none, or larger."""
    with os.fdopen(open_regular(path), "rb") as file:
        size = os.fstat(file.fileno()).st_size
        content = file.read(most_bytes + 1) if size <= most_bytes else b""
    if max(size, len(content)) > most_bytes:
        what = f"it has {size} bytes, more than the {most_bytes} that are read"
        raise OSError(errno.EFBIG, what, str(path))
    return content


def read_text(path: Path, encoding: str = "utf-8", errors: str = "strict") -> str:
    """Return the text of a regular file, with line feeds as the ends of its lines.

    encoding, errors: as of `bytes.decode`. Raises OSError as `read_file`, UnicodeDecodeError.
    """
    text = read_file(path, MOST_TEXT_BYTES).decode(encoding, errors)
    return text.replace("\r\n", "\n").replace("\r", "\n")


_FOLDER_MODE = 0o755
_FILE_MODE = 0o644


def make_folder(path: Path) -> None:
    """Make a folder and those above it, which only their owner may write to.

    Harmless where it is there. Raises OSError, also where something else has its name.
    """
    missing = list(itertools.takewhile(lambda each: not each.exists(), (path, *path.parents)))
    for folder in reversed(missing):
        with contextlib.suppress(FileExistsError):
            folder.mkdir(_FOLDER_MODE)
    if not path.is_dir():
        raise FileExistsError(errno.EEXIST, "there is something else of that name", str(path))


def make_new_folder(path: Path) -> None:
    """Make a folder that is not there yet; raises FileExistsError where anything is."""
    make_folder(path.parent)
    path.mkdir(_FOLDER_MODE)


def append_to(path: Path) -> int:
    """Return a descriptor to read a file and append to it; it is made where it is missing.

    Raises OSError, also where a link has its name.
    """
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    return os.open(path, flags, _FILE_MODE)


def is_shared(folder: Path) -> bool:
    """Return whether every user of the machine may write to a folder."""
    with contextlib.suppress(OSError):
        return bool(folder.stat().st_mode & stat.S_IWOTH)
    return False


_KINDS: Mapping[str, Callable[[int], bool]] = {
    "a folder": stat.S_ISDIR,
    "a link": stat.S_ISLNK,
    "a named pipe": stat.S_ISFIFO,
    "a socket": stat.S_ISSOCK,
}


def irregular(path: Path) -> str:
    """Return what is there that no file must take the place of; empty for a file, or nothing."""
    try:
        mode = path.lstat().st_mode
    except OSError:
        return ""
    if stat.S_ISREG(mode):
        return ""
    return next((kind for kind, fits in _KINDS.items() if fits(mode)), "a device")


_TAIL_BYTES = 16_000
_LONGEST = 300
_TRACEBACK = "Traceback (most recent call last):"

_ERROR = re.compile(
    r"error|exception|panic|fatal|fail|cannot|can't|could not|assert|not found|unable"
    # Perl's `die`.
    r"| at \S+ line \d+[.,]"
    # Lua's `error`, by the name of its interpreter.
    r"|^\S*\blua[\d.]*: ",
    re.IGNORECASE,
)
_NOISE = re.compile(
    r"pybullet build time:"  # printed whenever it is loaded
    r"|error: called from|error: ignoring const "  # Octave, behind its error
    r"|BEGIN failed--|Compilation failed in require|Execution of .* aborted due to"  # Perl
    r"|note: |help: |stack backtrace:"  # Rust
    r"|stack traceback:$"  # Lua, behind its error
    r"|Node\.js v\d|exit status \d|goroutine \d|Exception ignored "
    r"|.*\b(0|no) (errors?|failures?|exceptions?)\b",
    re.IGNORECASE,
)
_JOINED = re.compile(
    r"thread '.*' .*panicked at .*:$"  # Rust: the message is in the next line
    r"|terminate called after throwing an instance of "  # C++: likewise, behind `what():`
)


def last_error(log: Path) -> str:
    """Return the cause of the last error in a log, or else its last line; empty where none is.

    It is the line that names the error, not the stack or the hints that languages print behind it.
    """
    try:
        with log.open("rb") as file:
            file.seek(max(0, file.seek(0, 2) - _TAIL_BYTES))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    lines = [line.rstrip() for line in text.split("\n")]
    lines = [line for line in lines if line and not _NOISE.match(line.lstrip())]
    cause = _cause(lines)[:_LONGEST]
    return cause + import_error_hint(cause)


def _cause(lines: Sequence[str]) -> str:
    errors = [index for index, line in enumerate(lines) if _ERROR.search(line)]
    # Stacks are indented, and may be of files and functions called `error`.
    at = [index for index in errors if not lines[index][0].isspace()] or errors
    raised = _raised(lines)
    joined = [index for index in at if _JOINED.match(lines[index])]
    if raised is not None and not any(index > raised for index in joined):
        return lines[raised].strip()
    if joined:
        return " ".join(line.strip() for line in lines[joined[-1] : joined[-1] + 2])
    return (lines[at[-1]] if at else lines[-1] if lines else "").strip()


def _raised(lines: Sequence[str]) -> int | None:
    """Return the line of the exception below the last traceback of Python.

    Its message may have further lines, and what is printed at the exit stands behind it.
    """
    starts = [index for index, line in enumerate(lines) if line.startswith(_TRACEBACK)]
    if not starts:
        return None
    below = range(starts[-1] + 1, len(lines))
    return next((index for index in below if not lines[index][0].isspace()), None)
