"""The bridge as a process: `python -m stepbus_bridge`, which `stepbus bridge` starts."""

import sys

from stepbus_bridge import take_part

if __name__ == "__main__":
    sys.exit(take_part(sys.argv[1:]))
