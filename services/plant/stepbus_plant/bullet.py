"""Loads PyBullet, which prints when it was built.

It does so in C on descriptor 1: that of the user's program, where a run is in its process.
"""

import ctypes
import os
from importlib import import_module

_flush = ctypes.CDLL(None).fflush


def load() -> None:
    """Import PyBullet; what it prints goes to descriptor 2."""
    try:
        stdout, stderr = os.dup(1), os.dup(2)
    except OSError:
        import_module("pybullet")
        return
    _flush(None)
    os.dup2(stderr, 1)
    try:
        import_module("pybullet")
    finally:
        _flush(None)
        os.dup2(stdout, 1)
        os.close(stdout)
        os.close(stderr)


load()
