"""The command line: a thin layer over the library, and the only code that prints or exits."""

# The command `stepbus` takes signals before it loads anything else.
from .entry import main

__all__ = ["main"]
