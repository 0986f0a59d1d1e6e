"""The command line: a thin layer over the library, and the only code that prints or exits."""

from .entry import main

__all__ = ["main"]
