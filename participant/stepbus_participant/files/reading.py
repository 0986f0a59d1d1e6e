"""Reads files that users name: regular ones, of a size that fits into memory.

A named pipe would wait for somebody who writes to it, and `/dev/zero` has no end.
"""

import errno
import os
import stat
from pathlib import Path

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
