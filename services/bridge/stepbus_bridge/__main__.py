"""The bridge as a process: `python -m stepbus_bridge`, which `stepbus bridge` starts."""

import argparse
import sys
from collections.abc import Sequence

import msgspec

from stepbus_bridge.bridge import Bridge
from stepbus_bridge.map_bridge import MapBridge
from stepbus_bridge.raw_bridge import RawBridge
from stepbus_participant import Config, main
from stepbus_schemas import BRIDGE_FORMATS, UNDECODABLE, Description, explained


def _take_part(arguments: Sequence[str]) -> int:
    """Take part in a run for a program; return the exit code once the program has ended too.

    By then it has left the run: the program may finish work of its own, such as a plot. arguments:
    of the command `stepbus bridge`; exits where they are wrong.
    """
    parser = argparse.ArgumentParser(prog="stepbus bridge")
    parser.add_argument("--format", choices=BRIDGE_FORMATS, default="json")
    parser.add_argument("--describe", type=_described, default={}, metavar="JSON")
    parser.add_argument("program", nargs="+", help="path of the program and its arguments")
    args = parser.parse_args(arguments)
    cls = RawBridge if args.format == "raw" else MapBridge
    made: list[Bridge] = []

    def make(config: Config) -> Bridge:
        made.append(cls(config, args.program, args.format, args.describe))
        return made[0]

    code = main(make)
    for bridge in made:
        if error := bridge.await_end():
            sys.stderr.write(f"{error}\n")
            code = 1
    return code


def _described(text: str) -> dict[str, Description]:
    try:
        return msgspec.json.decode(text, type=dict[str, Description])
    except UNDECODABLE as exc:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a map of descriptions: {explained(exc, Description)}"
        ) from exc


if __name__ == "__main__":
    sys.exit(_take_part(sys.argv[1:]))
