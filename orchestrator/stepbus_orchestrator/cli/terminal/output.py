"""Where the command line prints."""

import os
import sys
from pathlib import Path

import msgspec


def open_closed_streams() -> None:
    """Put the null device where a standard stream is closed, as after `stepbus run … <&-`.

    Python has None there, and the next file that is opened would get the stream's descriptor.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115


def say(text: str) -> None:
    """Print a line for people."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def print_error(text: str) -> None:
    """Print an error."""
    sys.stderr.write(f"stepbus: {text}\n")
    sys.stderr.flush()


def say_json(value: object) -> None:
    """Print a value for programs."""
    say(msgspec.json.format(msgspec.json.encode(value, enc_hook=os.fspath), indent=2).decode())
