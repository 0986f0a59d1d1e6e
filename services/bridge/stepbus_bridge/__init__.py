"""The bridge: takes part in a run for a program without Zenoh (docs/guide/writing/bridge.md)."""

import argparse
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from stepbus_participant import Config, Participant
from stepbus_schemas import BRIDGE_FORMATS, UNDECODABLE, explained

from .map_bridge import MapBridge
from .raw_bridge import RawBridge

__all__ = ["bridge_to"]


def bridge_to(arguments: Sequence[str]) -> Callable[[Config], Participant]:
    """Return what makes the bridge to a program; exits where the arguments are wrong.

    arguments: of the command `stepbus bridge`.
    """
    parser = argparse.ArgumentParser(prog="stepbus bridge")
    parser.add_argument("--format", choices=BRIDGE_FORMATS, default="json")
    parser.add_argument("--describe", type=_described, default={}, metavar="JSON")
    parser.add_argument("program", nargs="+", help="path of the program and its arguments")
    args = parser.parse_args(arguments)
    bridge = RawBridge if args.format == "raw" else MapBridge
    return lambda config: bridge(config, args.program, args.format, args.describe)


def _described(text: str) -> Any:
    try:
        return msgspec.json.decode(text, type=dict[str, dict[str, Any]])
    except UNDECODABLE as exc:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a map of descriptions: {explained(exc)}"
        ) from exc
