"""Where the command line prints."""

from __future__ import annotations

import sys

import msgspec


def say(text: str) -> None:
    """Print a line for people."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def complain(text: str) -> None:
    """Print an error."""
    sys.stderr.write(f"stepbus: {text}\n")
    sys.stderr.flush()


def say_json(value: object) -> None:
    """Print a value for programs."""
    say(msgspec.json.format(msgspec.json.encode(value), indent=2).decode())
