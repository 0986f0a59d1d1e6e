"""The environment variables of this process, which threads of it read while another changes them.

A program that is started without variables of its own reads them where they are: its start fails
(EFAULT, "Bad address") when a thread removes one meanwhile.
"""

import contextlib
import os
import threading
from collections.abc import Iterator, Mapping

_changing = threading.Lock()


def environment() -> dict[str, str]:
    """Return a copy of the variables, to start a program with."""
    with _changing:
        found = ((name, os.environ.get(name)) for name in list(os.environ))
        # Code of the user's may have removed one meanwhile.
        return {name: value for name, value in found if value is not None}


@contextlib.contextmanager
def variables(values: Mapping[str, str | None]) -> Iterator[None]:
    """Set variables, or remove those that are None, and put back what was there."""
    before = {name: os.environ.get(name) for name in values}
    _set(values)
    try:
        yield
    finally:
        _set(before)


def _set(values: Mapping[str, str | None]) -> None:
    with _changing:
        for name, value in values.items():
            if value is not None:
                os.environ[name] = value
            else:
                os.environ.pop(name, None)
