"""What simulated code must not do: take the real time, start anything, roll dice, write files."""

import builtins
import hashlib
import io
import os
import random
import resource
import secrets
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from typing import Any
from unittest.mock import Mock, patch


class Escape(BaseException):
    """Simulated code has done something that the simulation does not control."""


_ESCAPES: tuple[tuple[Any, str], ...] = (
    *((time, name) for name in ("monotonic", "monotonic_ns", "time", "time_ns", "sleep")),
    *((time, name) for name in ("perf_counter", "perf_counter_ns", "process_time")),
    *((random, name) for name in ("random", "randrange", "randint", "choice", "shuffle")),
    *((secrets, name) for name in ("randbits", "token_bytes", "choice")),
    (os, "urandom"),
    (os, "fork"),
    (os, "posix_spawn"),
    (os, "system"),
    (os, "kill"),
    (threading.Thread, "start"),
    (threading.Event, "wait"),
    (threading.Condition, "wait"),
    (socket, "socket"),
    (subprocess, "Popen"),
)


_FILES: tuple[tuple[Any, str], ...] = (
    (os, "rename"),
    (os, "replace"),
    (os, "truncate"),
)
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
_open, _os_open = io.open, os.open


def _read_only(path: Any, mode: str = "r", *more: Any, **options: Any) -> Any:
    if set(mode) & set("wax+"):
        raise Escape(f"{path} was opened for writing, beside the simulated disk")
    return _open(path, mode, *more, **options)


def _os_read_only(path: Any, flags: int, *more: Any, **options: Any) -> int:
    if flags & _WRITES:
        raise Escape(f"{path} was opened for writing, beside the simulated disk")
    return _os_open(path, flags, *more, **options)


def _refuse(what: str) -> Callable[..., Any]:
    def refuse(*_arguments: Any, **_options: Any) -> Any:
        raise Escape(f"{what} was called in a simulated run")

    return refuse


@contextmanager
def no_escapes(*, writes_files: bool = False) -> Iterator[None]:
    """Raise Escape where code does any of that; tokens are the same in each run.

    writes_files: whether files may be written, beside those of the simulated disk.
    """
    numbers = count()

    def token_hex(size: int = 32) -> str:
        return hashlib.sha256(str(next(numbers)).encode()).hexdigest()[: 2 * size]

    with ExitStack() as stack:
        for owner, name in (*_ESCAPES, *(() if writes_files else _FILES)):
            what = f"{getattr(owner, '__name__', owner)}.{name}"
            stack.enter_context(patch.object(owner, name, _refuse(what)))
        stack.enter_context(patch.object(secrets, "token_hex", token_hex))
        stack.enter_context(patch.object(resource, "prlimit", Mock()))
        if not writes_files:
            stack.enter_context(patch.object(builtins, "open", _read_only))
            stack.enter_context(patch.object(io, "open", _read_only))
            stack.enter_context(patch.object(os, "open", _os_read_only))
        yield
