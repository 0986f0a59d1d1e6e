"""The command line of the bridge."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from stepbus_bridge.bridge import BridgedProgram
from stepbus_participant import Config, Participant
from stepbus_schemas import BRIDGE_FORMATS, UNDECODABLE, explained

from .map_bridge import MapBridge
from .raw_bridge import RawBridge


def bridge_to(arguments: Sequence[str]) -> Callable[[Config], Participant]:
    """Return what makes the bridge to a program; exits where the arguments are wrong."""
    parser = argparse.ArgumentParser(prog="stepbus bridge")
    parser.add_argument("--format", choices=BRIDGE_FORMATS, default="json")
    parser.add_argument("--describe", type=_describe, default={}, metavar="JSON")
    parser.add_argument("program", nargs="+", help="path of the program and its arguments")
    args = parser.parse_args(arguments)
    program = BridgedProgram(argv=args.program, format=args.format, describe=args.describe)

    def make(config: Config) -> Participant:
        return (RawBridge if program.format == "raw" else MapBridge)(config, program)

    return make


def _describe(text: str) -> Mapping[str, Mapping[str, Any]]:
    try:
        return msgspec.json.decode(text, type=dict[str, dict[str, Any]])
    except UNDECODABLE as exc:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no map of descriptions: {explained(exc)}"
        ) from exc
