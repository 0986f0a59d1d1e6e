"""Take part in a run in the stead of a program: `stepbus bridge` without the other commands."""

from __future__ import annotations

import argparse
import sys

from .arguments import add_arguments, execute


def _main() -> int:
    parser = argparse.ArgumentParser(prog="stepbus bridge")
    add_arguments(parser)
    return execute(parser.parse_args())


if __name__ == "__main__":
    sys.exit(_main())
