"""The command line of the bridge, with and without `stepbus` before it."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

import msgspec

from stepbus_participant import Config, Participant, main

from .formats import FORMATS
from .maps import MapBridge
from .participant import Task
from .raw import RawBridge


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the bridge understands."""
    parser.add_argument("--format", choices=FORMATS, default="json", help="what the program speaks")
    parser.add_argument(
        "--describe",
        type=_describe,
        default={},
        metavar="JSON",
        help='what the outputs are, e.g. {"command": {"like": "joint_state"}}',
    )
    parser.add_argument("program", nargs="+", help="its command, behind `--`")


def _describe(text: str) -> Mapping[str, Mapping[str, Any]]:
    try:
        return msgspec.json.decode(text, type=dict[str, dict[str, Any]])
    except msgspec.DecodeError as exc:
        raise argparse.ArgumentTypeError(f"{text!r} is no map of descriptions: {exc}") from exc


def bridge(task: Task) -> int:
    """Take part in the run of this process's ticket; return the exit code as `main` does."""

    def make(config: Config) -> Participant:
        return (RawBridge if task.form == "raw" else MapBridge)(config, task)

    return main(make)


def execute(args: argparse.Namespace) -> int:
    """Bridge the program of a command line."""
    return bridge(Task(words=args.program, form=args.format, describe=args.describe))
