"""The bridge as a process: `python -m stepbus_bridge`, which `stepbus bridge` starts."""

import sys

from stepbus_bridge import bridge_to
from stepbus_participant import main

if __name__ == "__main__":
    sys.exit(main(bridge_to(sys.argv[1:])))
